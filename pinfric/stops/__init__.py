"""Stops: how long the robot takes, how far it goes, and what brakes and gears bear."""
