"""Samples of a motion: their states, reactions and results; no coupled friction is solved here.

`states` checks shapes and numbers; `closure` solves the dependent joints of loops; `reactions` gets
the wrenches at the joints from Pinocchio, in batches; `reversals` finds where joints pass through
rest; `motion_kernels` computes loads, friction and efforts from wrenches, `threaded` on several
threads; `motor_torques` computes motor torques from efforts; `outcome` holds results.
"""
