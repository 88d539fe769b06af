"""Forward dynamics: the acceleration that given efforts cause at one instant.

`forward` checks the state, `efforts` the efforts of the drives. `workspace` holds the buffers: it
calls the kernels that write the friction problem and try modes, and searches modes where joints
rest. `failures` raises an error if there is no solution. For integrators, `constraints` keeps loops
closed and sticking joints in place, and `margins` computes how far sticking joints are from
slipping. `holds` decides whether friction holds the robot at rest. `solver` offers forward and
inverse dynamics for control loops; `compensation` is the friction that a controller adds.
"""
