"""Replay of a motion in 3D, as a page."""
