"""Friction: the coupled problem in which friction and reactions depend on each other.

Takes: a `Problem`: loads as affine functions of friction, the laws, and where joints slide or rest.

Steps: `search` tries the likely modes first, `given_modes` solves one with its certificate
(`anderson`, `balance`; `sliding` where nothing rests and one solution is certain), `branching` and
`several` look at all others; `holding` and `least_use` decide whether friction can hold a robot at
rest.

Gives: friction and mode of each joint, or that there is no solution, or several.
"""
