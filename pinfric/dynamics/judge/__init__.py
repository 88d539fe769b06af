"""Recomputes results without the solver.

`check` takes a result apart sample by sample: `plain_laws` are the friction laws in plain NumPy;
`linkage`, `balance` and `pairs` are equilibrium where loops close; `states` and `search` find the
states of friction that obey the laws by an enumeration and interval arithmetic of their own.
"""
