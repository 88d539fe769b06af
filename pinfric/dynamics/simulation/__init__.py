"""Simulation of motions in time.

`simulate` checks the arguments and chooses the method: `event` stops where a joint sticks or breaks
away, which `crossing` locates; `timestepping` takes fixed steps; `regularized` smooths friction.
All use `integration` (state, pieces between breakpoints) and `system` (efforts, accelerations).
`recorder` records samples and events, `motion` is the result, `motion_file` reads it from a file.
"""
