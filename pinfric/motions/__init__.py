"""Motions: what the joints do over time, and what a motion's efforts come to.

Takes: a scene, and a file of samples (CSV, Parquet, ROS 2 bag, MATLAB) or way-points, or arrays.

Steps: `read_log` (in `log`) reads a file's columns, units and rows, its noise and holds;
`read_waypoints` and `sample_waypoints` make samples of way-points; `complete_derivatives` adds v
and a; `complete_motion` closes loops.

Gives: `Trajectory` (t, q, v, a, what is carried) with its warnings; `summarize` reduces the efforts
of an inverse result to peak, RMS and rests of each drive.
"""
