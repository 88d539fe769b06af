"""Stops: how long the robot takes, how far it goes, and what brakes and gears bear.

Takes: a scene with `stops`, transmissions and brakes, and a cycle.

Steps: `stop_settings` chooses the category; `Machines` has a scene for each load and friction;
`estimates` ranks the cycle's samples; `StopSearch` simulates the worst and their neighbours
(`stop_motion`).

Gives: `StopResult`: the worst stop of each axis, by payload and speed, with its criteria.
"""
