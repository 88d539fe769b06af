"""Writes the friction problem of a state.

The steps for a state, in order: `plan` gives the indices of drives, friction, contacts and loops of
the scene in the arrays; `machine` makes the arrays that kernels write; `supply` gets poses, bias
forces and inertias from Pinocchio; `rates` writes velocities and each joint's law of friction;
`accelerations` and `wrenches` write accelerations, multipliers, wrenches and contact forces as
affine functions of friction, `gearing` rotors and the laws of gears. Inverse dynamics uses `affine`
as well. `instant` does all steps in one call, tries modes and finishes.
"""
