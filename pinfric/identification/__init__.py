"""Identification: a robot's friction from its own logs, with intervals.

Takes: a scene and logs with measured efforts.

Steps: `read_recordings` reads the logs; `estimate` finds delay, laws, inertias and coefficients in
passes; `nested_errors` judges the laws on unused blocks; `uncertainty` gives intervals; `notes`
says what the logs do not determine.

Gives: `Identified`: a scene with that friction, its posterior, its errors, and advice for the next
recording.
"""
