"""What compiling costs: processor time of every kernel that a scene needs, with an empty cache.

    python benchmarks/compile_time.py                 an open chain and a loop
    python benchmarks/compile_time.py pendulum        a bundled scene

Numba reports each compilation; the time of a kernel has that of its callees taken out. Compare two
commits on one machine: a kernel more, or a longer one, is a choice.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections import Counter

SCENES = ("ur10_machine_tending", "excavator")


def measure(names: list[str]) -> None:
    """Compile what scenes need, one after the other; print the dearest kernels of each."""
    import pinfric as pf  # isort: skip - before numba: the cache's folder is set

    from numba.core import event

    class Times(event.Listener):
        """Processor time of each kernel (s), without its callees."""

        def __init__(self) -> None:
            self.seconds, self.open = Counter(), []

        def on_start(self, event: event.Event) -> None:
            self.open.append([time.process_time(), 0.0])

        def on_end(self, event: event.Event) -> None:
            start, callees = self.open.pop()
            whole = time.process_time() - start
            self.seconds[event.data["dispatcher"].py_func.__name__] += whole - callees
            if self.open:
                self.open[-1][1] += whole

    for name in names:
        scene, times, start = pf.load_scene(name), Times(), time.process_time()
        with event.install_listener("numba:compile", times):
            pf.warm_up(scene)
        print(f"{name}: {time.process_time() - start:.1f} s, {len(times.seconds)} kernels")
        for kernel, seconds in times.seconds.most_common(15):
            print(f"    {kernel:40} {seconds:6.2f}")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.environ["NUMBA_CACHE_DIR"] = folder
        measure(sys.argv[1:] or list(SCENES))
