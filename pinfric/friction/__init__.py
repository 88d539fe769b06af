"""Solver of the coupled friction problem, in which friction and reactions depend on each other."""
