"""The coupled problem in which friction and reactions depend on each other.

Takes: a `Problem`: loads as affine functions of friction, the laws, and where joints slide or rest.

Steps: `search` tries modes of what rests, island by island (`islands`), in the `ways` that
kinematics allows, of an open chain those that its `certificate` leaves; `rest` solves one of them,
`given_modes` with its certificate, `sharing` where joints can only move together; `several` finds
all solutions. `holding`, `least_use` and `branching` decide whether friction can hold a robot at
rest.

Gives: friction and mode of each joint, or that there is no solution, or several.
"""
