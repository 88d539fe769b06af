"""Accuracy: what it costs in time.

Takes: a scene with a `simulation`; for `explain` a motion.

Steps: `reference` simulates 100 times tighter than any contestant, `contestants` are methods with
settings, `compete` gives errors and seconds; `explain` leaves out one effect at a time.

Gives: `Accuracy`, a row a run; `Explanation`, a row an effect.
"""
