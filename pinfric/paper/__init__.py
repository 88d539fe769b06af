"""The paper in a room of its own: its formulation, its examples, and what is made of them.

`bodies`, `equations`, `inverse`, `forward`, `simulate` and `examples` are the independent judge:
absolute coordinates with Euler parameters, nothing of the rest of pinfric, no Pinocchio.
`reproduction`, `figures` and `report` set both formulations beside what is printed.

Park, Yoo, Hwang, Bae: Inverse Dynamic Analysis of Constrained Multibody Systems Considering
Friction Forces on Kinematic Joints, 1999. Equation numbers in this folder are the paper's.
"""
