"""Recomputes results without the solver.

`check` judges a result sample by sample. `plain_laws` has the friction laws in plain NumPy.
`linkage`, `balance` and `pairs` compute the equilibrium of mechanisms with loops. `states` and
`search` find the states of friction that obey the laws, by a separate enumeration and interval
arithmetic.
"""
