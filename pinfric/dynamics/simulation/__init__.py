"""Simulation of motions in time.

`simulate` checks the arguments and chooses the method: `event` locates where joints stick and break
away (`crossing`), `timestepping` takes fixed steps, `regularized` smooths friction. All use
`integration` (state, pieces between breakpoints) and `system` (efforts, accelerations); `recorder`
makes the `motion`, which `motion_file` reads from a file.
"""
