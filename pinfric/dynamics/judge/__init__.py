"""Recomputes results without the solver."""
