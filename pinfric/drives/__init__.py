"""Drives: motors, gears, bearings and brakes as catalogues have them, and what bounds them.

Takes: a catalogue (YAML, or a table of a maker), conditions, and the result of a cycle.

Steps: `load_catalog` reads parts; `drive_cycle` and `gear_demand` reduce a cycle to what a drive
sees; `motor_cycle` adds a motor's torque, heat and power; `check` holds all against `LIMITS`.

Gives: a `Criterion` for each row: required, available, margin, or what is missing.
"""
