"""Writes the friction problem of a state: plan, reactions, affine maps, gears."""
