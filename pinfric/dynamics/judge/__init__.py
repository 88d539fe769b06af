"""Recomputes results without the solver.

`check` judges a result sample by sample. `plain_laws` has the friction laws in plain NumPy,
`sample` the equilibrium, `states` the states of friction that obey the laws.
"""
