"""Friction of a robot from its own logs: which law, which coefficients, how uncertain."""
