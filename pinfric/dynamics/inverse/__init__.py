"""The efforts that a motion takes.

`inverse` checks the motion and hands open chains to `tree`, where reactions do not depend on
friction, and all other scenes to `linkage`. There `linkage_batch` and `effort_maps` write efforts
and contact forces as affine functions of friction, `choices` lists what each joint's friction can
be, `interval_ends` finds the least and the greatest effort where joints stick, `solutions` all
states of friction of one sample, `undriven` what a joint without drive tells. `outcome` says how a
sample ended, `result` is what the user gets. `superposed` does open chains again with other masses
and coefficients, for sweeps.
"""
