"""Elastic gears: wind-up, the tool's place at rest, natural frequencies.

Takes: a rigid `InverseResult`, which stays as it is, of a scene whose gears have a stiffness.

Steps: `elasticity` finds the rests, winds up each gear by its torque, moves the tool by the sum
(`places`), and solves for the lowest frequencies with motors held (`vibration`).

Gives: `Elasticity`; `elastic_summary` describes it, `elastic_effect` says whether it matters.
"""
