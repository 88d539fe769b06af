"""Sweeps: how efforts vary with what is not known for certain.

Takes: a scene, a cycle, and a file of parameters with distributions and drives on trial.

Steps: `resolve` finds what each parameter changes, `motors_on_trial` equips the scene, `draw` draws
the samples; `compute` reduces each to a few figures, from stored parts where it is a sum of them
(`superposition`), here, on processes or a cluster (`workers`).

Gives: `SweepResult`: percentiles, how often motors suffice, and which parameters decide.
"""
