"""Derivatives of inverse and forward dynamics of open chains, and a smoothed law of friction.

`wrenches` differentiates the wrenches at the joints, and so the loads of their bearings; `efforts`
friction, efforts, gears and accelerations, in one kernel each. `tables` makes what the kernels read
and write. `derivatives` offers them for one state at a time, `parameters` the same by coefficients
and inertias, `smoothed` with friction that is smooth through rest.
"""
