"""Motions in time: integrators, events, what they record."""
