"""The paper's own formulation and examples.

`bodies`, `equations`, `inverse`, `forward`, `simulate` and `examples` are the independent judge:
absolute coordinates with Euler parameters, no Pinocchio, nothing else of pinfric but its errors.
`reproduction`, `figures` and `report` compare both formulations with the printed results.

Park, Yoo, Hwang, Bae: Inverse Dynamic Analysis of Constrained Multibody Systems Considering
Friction Forces on Kinematic Joints, 1999. Equation numbers in this folder are the paper's.
"""
