"""Writes the friction problem of a state.

What a state meets here, in order: `states` checks shapes and numbers; `layout` and `machine` say
where joints, drives, friction and loops of the scene stand in the arrays, `buffers` makes them;
`closure` solves the joints that loops lead; `reactions` gets the wrenches at the joints from
Pinocchio, in `threaded` kernels for many samples; `maps` writes accelerations, contact forces and
wrenches as affine functions of friction, with the gears' lines of `gearing`; `motor_torques` turns
efforts at the joints into torques of motors, `reversals` says where joints pass through rest.
"""
