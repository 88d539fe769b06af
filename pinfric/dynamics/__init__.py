"""From states of motion to efforts, from efforts to accelerations, and on in time.

`samples` holds the states of a motion, their reactions and their results; `problem` writes the
friction problem of a state. `inverse` finds the efforts of a motion, `judge` recomputes them,
`forward` finds accelerations at one instant, `simulation` follows them in time.
"""
