"""Measure first: it imports pinfric before Pinocchio, and lets kernels be compiled."""

import measure  # noqa: F401
