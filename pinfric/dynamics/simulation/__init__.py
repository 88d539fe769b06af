"""Motions in time.

`simulate` checks what is asked and chooses the method: `event` stops where a joint sticks or breaks
away, found by `crossing`; `timestepping` takes fixed steps; `regularized` smooths friction. They
share `integration` (state and pieces between breakpoints) and `system` (efforts and accelerations).
`recorder` writes down what happens, `motion` is what the user gets, `motion_file` keeps it.
"""
