"""The entry of the command line: Ctrl-C and SIGTERM end it at any time, in one line, with code 130.

The handler is set before every import that takes time: an interrupt during an import would end in a
traceback, or be lost in a C++ library that clears Python's exceptions.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import NoReturn

INTERRUPTED = 130
_LINE = b"pinfric: error: interrupted\n"
#: Where LLVM calls back, what Python raises is printed and lost: asked again so much later (s).
_COMPILER, _AGAIN = f"{os.sep}llvmlite{os.sep}", 0.02
#: Other C code that calls back may clear it without a word (NumPy, in an array's subclass): raised
#: again so much later (s), unless it is being handled.
_LOST = 0.5
#: Files whose functions tidy up what is half done, if an interrupt is raised below them.
_TIDIES = tuple(
    os.path.join("pinfric", *file) for file in (("model", "files.py"), ("model", "urdf_file.py"))
)
#: The module that holds a sweep's processes.
_LOKY = "joblib.externals.loky.reusable_executor"
#: Signals that came.
_asked: list[int] = []
#: On a terminal, first: to the line's begin, clear it, show the cursor that a progress bar hides.
_TIDY = b"\r\x1b[K\x1b[?25h"


def main() -> NoReturn:
    """Run the command line and exit."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as `nohup` and `&` have it
        signal.signal(signal.SIGINT, _interrupt)
    for number in (signal.SIGTERM, signal.SIGALRM):
        signal.signal(number, _interrupt)
    _open_standard_streams()
    # before NumPy loads: products over many samples are short, and threads that wait for the next
    # one spin; also of a sweep's processes, one a core
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from pinfric.cli import main as run

    try:
        run()
    except (SystemExit, KeyboardInterrupt) as ended:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is said and written: let Python end
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        _end_workers()
        # when all but the exit was done; or where it made a library fail that just started
        if isinstance(ended, KeyboardInterrupt) or (_asked and ended.code not in (0, INTERRUPTED)):
            os.write(2, _LINE)
        elif ended.code != INTERRUPTED:
            raise
        _end()
    raise AssertionError  # `run` ends in an exit code


def _open_standard_streams() -> None:
    """Use no file for a stream that the caller closed: another file would take its place."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            with suppress(OSError):  # it is open by now
                os.fstat(number)
                continue
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
            stream = open(number, mode, encoding="utf-8")  # noqa: SIM115
            setattr(sys, name, stream)
            setattr(sys, f"__{name}__", stream)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Raise `KeyboardInterrupt`; during an import, where no file is half written, exit at once.

    It is raised later while LLVM compiles, and in an import with files half written or worker
    processes.
    """
    _asked.append(number)
    stack = []
    while frame is not None:
        stack.append((frame.f_code.co_filename, frame.f_code.co_name))
        frame = frame.f_back
    compiling = any(_COMPILER in file for file, _ in stack)
    importing = any(file.startswith("<frozen importlib") for file, _ in stack)
    half_done = any(file.endswith(_TIDIES) and name != "<module>" for file, name in stack)
    if compiling or (importing and (half_done or _LOKY in sys.modules)):
        signal.setitimer(signal.ITIMER_REAL, _AGAIN)
        return
    if not importing:
        signal.setitimer(signal.ITIMER_REAL, _LOST)
        if _is_handled(sys.exc_info()[1]):
            return
        raise KeyboardInterrupt
    os.write(2, (_TIDY if os.isatty(2) else b"") + _LINE)
    os._exit(INTERRUPTED)


def _is_handled(error: BaseException | None) -> bool:
    """Whether the code that runs tidies up after an interrupt."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None


def _end_workers() -> None:
    """Kill the processes that a sweep keeps waiting for the next one."""
    if _LOKY in sys.modules and (executor := sys.modules[_LOKY]._executor) is not None:
        with suppress(RuntimeError):  # its thread was to start when the interrupt came
            executor.shutdown(wait=True, kill_workers=True)


def _end() -> NoReturn:
    """Exit as Python does, but without waiting for other threads, and with our own exit code.

    Python itself ends by SIGINT if code made of text (`exec`) was interrupted.
    """
    import atexit

    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()
