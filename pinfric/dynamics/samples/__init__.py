"""Samples of a motion: their states, reactions and results; no coupled friction is solved here.

`states` checks shapes and numbers; `closure` solves the joints that loops lead, and measures loops'
joints; `reactions` gets the wrenches at the joints from Pinocchio, a batch at a time; `reversals`
says where joints pass through rest; `motion_kernels` turns wrenches into loads, friction and
efforts, `threaded` the same on several threads; `motor_torques` turns efforts at the joints into
torques of motors; `outcome` says how a sample ended.
"""
