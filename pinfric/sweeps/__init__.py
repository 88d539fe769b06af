"""Sweeps: how efforts vary with uncertain parameters.

Takes: a scene, a cycle, and a file of parameters with distributions and drives on trial.

Steps: `resolve` finds what each parameter changes, `motors_on_trial` equips the scene, `draw` draws
the samples; `compute` reduces each to a few figures, from stored cycles where it is a sum of them
(`superposition`), in this process, on others or a cluster (`workers`).

Gives: `SweepResult`: percentiles, how often motors suffice, and which parameters decide.
"""
