"""Dynamics: inverse dynamics, forward dynamics and simulation with friction.

Takes: a scene, and states of a motion, or a start and efforts.

Steps: `samples` holds the states of a motion, their reactions and their results; `problem` writes
the friction problem of a state. `inverse` finds the efforts of a motion, `forward` finds
accelerations at one instant, `simulation` integrates them in time.

Gives: `InverseResult` (intervals of effort), accelerations, or `Motion` with its events.
"""
