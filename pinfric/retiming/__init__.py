"""Retiming: the fastest motion that real drives can do along a path.

Takes: an open chain, a path (way-points, spline or trajectory), and the limits of its drives.

Steps: `read_limits` asks `drives` for bounds; `PathProblem` writes efforts along the path as
functions of speed and acceleration; `scan` finds the fastest speed within all bounds; `thermal`
slows it until the motors stay cool; the result is sampled and judged by inverse dynamics.

Gives: `RetimeResult`: the trajectory, and which limit of which drive holds it back where.
"""
