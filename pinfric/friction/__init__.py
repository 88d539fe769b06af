"""Friction that depends on the reactions it changes: problems as numbers, without a robot."""
