"""Writes the friction problem of a state.

The steps for a state, in order: `plan` gives the indices of drives, friction, contacts and loops of
the scene in the arrays; `machine` makes the arrays that kernels write, and gets poses, bias forces
and inertias from Pinocchio; `accelerations` writes velocities, laws of friction and of gears, and
accelerations, `wrenches` multipliers, wrenches and contact forces as affine functions of friction.
`instant` does all steps in one call, tries modes and finishes. Where everything slides and no load
matters, `sliding` adds friction to the efforts, and one ABA is enough.
"""
