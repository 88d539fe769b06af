"""Writes the friction problem of a state.

What a state meets here, in order: `plan` says where drives, friction, contacts and loops of the
scene stand in the arrays, `machine` makes the arrays that kernels write; `supply` gets poses, bias
forces and inertias from Pinocchio; `rates` writes how everything moves and each joint's law of
friction, `accelerations` and `wrenches` write accelerations, multipliers, wrenches and contact
forces as affine functions of friction, with the gears' lines of `gearing`; `affine` is what inverse
dynamics shares with that. `instant` does it all in one call, tries modes and finishes.
"""
