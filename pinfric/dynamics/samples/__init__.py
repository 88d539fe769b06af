"""Samples of a motion: their states, reactions and results; no coupled friction is solved here.

`states` checks shapes and numbers; `closure` solves the dependent joints of loops and computes the
motion of loops' joints; `reactions` gets the wrenches at the joints from Pinocchio, in batches;
`reversals` finds where joints pass through rest; `motion_kernels` computes loads, friction and
efforts from wrenches, `threaded` does so on several threads; `motor_torques` computes motor torques
from efforts at the joints; `outcome` describes how a sample ended.
"""
