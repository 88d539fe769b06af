"""Kernels: numba functions, compiled once and kept, or interpreted while problems are small.

Takes: functions with the decorator `kernel`.

Steps: `compiled` compiles and caches them by their sources; `interpreted` runs them without
compiling; `arrays` makes the buffers that they write.

Gives: the same function, fast.
"""

#: Whether it is said that they compile, and whether one is being compiled now.
NOTICES: dict[str, bool] = {"compiling": True, "busy": False}
