"""Sweeps: how efforts vary with what is not known for certain."""
