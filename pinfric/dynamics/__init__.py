"""Inverse dynamics, forward dynamics and simulation with friction.

`samples` holds the states of a motion, their reactions and their results; `problem` writes the
friction problem of a state. `inverse` finds the efforts of a motion, `judge` recomputes them,
`forward` finds accelerations at one instant, `simulation` integrates them in time.
"""
