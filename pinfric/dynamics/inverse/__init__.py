"""Inverse dynamics: the efforts of a motion.

`inverse` checks the motion. It passes open chains, where reactions do not depend on friction, to
`tree`, and all other scenes to `linkage`. There `linkage_batch` and `effort_maps` write efforts and
contact forces as affine functions of friction, `choices` lists the possible frictions of joints,
`interval_ends` finds the least and the greatest effort where joints stick, `solutions` finds all
states of friction of one sample, and `undriven` uses the condition of joints without a drive.
`outcome` describes how a sample ended; `result` is returned to the user, and `check` puts it into
the equations again.
"""
