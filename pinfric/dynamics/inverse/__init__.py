"""Inverse dynamics: the efforts of a motion.

`inverse` checks the motion and passes it to `tree` (open chains, where reactions do not depend on
friction) or `linkage`. There `effort_maps` writes efforts and contact forces as affine functions of
friction, `choices` lists the possible frictions of joints, `interval_ends` finds the least and the
greatest effort where joints stick, `solutions` all states of friction of one sample. `undriven` is
the condition of joints without a drive. `result` is returned; `check` computes its residuals.
"""
