"""The acceleration that given efforts cause at one instant.

`forward` checks the state, `efforts` what drives are given. `workspace` holds the buffers: it lets
kernels write the friction problem and try modes, and searches modes where joints rest;
`self_locking` gives gears that lock their lines meanwhile; `failures` says why there is no answer.
`constraints` keeps a state on its loops and what sticks where it is, `margins` measures how far
that is from slipping: both for integrators. `holds` asks whether friction holds everything at rest.
`solver` is the same, and inverse dynamics of one state, for control loops; `compensation` is the
friction that a controller adds to its efforts.
"""
