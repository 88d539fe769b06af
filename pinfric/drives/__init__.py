"""Drives: motors, gears, bearings and brakes as catalogues have them, and what bounds them.

Takes: a catalogue (YAML, or a table of a maker), conditions, and the result of a cycle.

Steps: `load_catalog` reads parts; `drive_cycle` and `gear_demand` reduce a cycle to what a drive
sees; `motor_cycle` adds torque, heat and power of a motor; `check` holds all of it against
`LIMITS`, a table of rows with formula and source.

Gives: a `Criterion` for each row: required, available, margin, or what is missing.
"""
