"""Derivatives of inverse and forward dynamics of open chains, and a smoothed law of friction.

`wrenches` differentiates wrenches and loads, `efforts` friction, efforts, gears and accelerations,
as kernels over `tables`. `derivatives` calls them for one state, `smoothed` with friction that is
smooth through rest; `parameters` differentiates by coefficients and inertias.
"""
