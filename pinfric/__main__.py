"""Where the command line begins: one Ctrl-C ends it at any time, in one line, with exit code 130.

It stands before every import that takes time: an interrupt in the middle of one would end in a
traceback, or be lost where the module is a C++ library that clears what Python raises.
"""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType
from typing import NoReturn

INTERRUPTED = 130
_LINE = b"pinfric: error: interrupted\n"
#: Where LLVM calls back, what Python raises is printed and lost: asked again so much later (s).
_COMPILER, _AGAIN = f"{os.sep}llvmlite{os.sep}", 0.02
#: On a terminal, first: to the line's begin, clear it, show the cursor that a progress bar hides.
_TIDY = b"\r\x1b[K\x1b[?25h"


def main() -> NoReturn:
    """Run the command line and exit."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as `nohup` and `&` have it
        signal.signal(signal.SIGINT, _interrupt)
        signal.signal(signal.SIGALRM, _interrupt)
    from pinfric.cli import main as run

    try:
        run()
    except SystemExit as ended:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is said and written: let Python end
        if ended.code == INTERRUPTED:
            _end()
        raise
    raise AssertionError  # `run` ends in an exit code


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Within an import end at once: nothing is half done there. Else raise, so that all is tidied.

    What is written stands in folders that the next run removes; servers end with their reader.
    """
    while frame is not None:
        if _COMPILER in frame.f_code.co_filename:
            signal.setitimer(signal.ITIMER_REAL, _AGAIN)
            return
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            os.write(2, (_TIDY if os.isatty(2) else b"") + _LINE)
            os._exit(INTERRUPTED)
        frame = frame.f_back
    raise KeyboardInterrupt


def _end() -> NoReturn:
    """Exit as Python does, but without waiting for other threads, and by our own exit code.

    Python ends by SIGINT instead where one interrupted code that was made of text (`exec`).
    """
    import atexit

    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()
