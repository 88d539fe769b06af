"""Identification: friction of a robot from its own logs, with how uncertain it is.

Takes: a scene and logs with measured efforts.

Steps: `read_recordings` reads the logs; `estimate` finds in passes delay, laws, inertias and
coefficients; `nested_errors` judges the laws on blocks that did not choose them; `uncertainty`
gives intervals; `notes` says what the logs do not determine.

Gives: `Identified`: a scene with that friction, its posterior, its errors, and advice for the next
recording.
"""
