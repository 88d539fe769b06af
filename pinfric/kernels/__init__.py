"""Kernels: numba functions, compiled once and kept, or interpreted while problems are small.

Takes: functions with the decorator `kernel`.

Steps: `compiled` compiles and caches them by their sources; `interpreted` runs them as Python;
`arrays` makes the buffers that they write.
"""

#: Whether it is said that they compile, and whether one is being compiled now.
NOTICES: dict[str, bool] = {"compiling": True, "busy": False}
