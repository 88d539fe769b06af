"""Inverse dynamics: the efforts of a motion.

`inverse` checks the motion and passes it to `tree` (open chains, where reactions do not depend on
friction) or `linkage`. There `effort_maps` makes `LinkedSamples`: efforts and contact forces of a
batch as affine functions of friction. `choices` lists the possible frictions of each site,
`interval_ends` finds the least and the greatest effort (`Ends`), `solutions` all states of friction
of one sample. `undriven` is the condition of joints without a drive. `result` is returned; `check`
computes its residuals.
"""
