"""The model: scene, robot, wrench twin, bearings, laws of friction, drives, loops.

Takes: a scene file (YAML) and a URDF, or a Pinocchio model with entries.

Steps: `load_scene` reads the file by its schema; `Robot` loads the URDF; `Scene` checks the entries
against it and makes sites, drives, linkage, and the twin whose joints report wrenches.

Gives: `Scene`, which never changes; entries described with text, unit and example.
"""
