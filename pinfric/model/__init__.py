"""The description of a scene: robot, wrench twin, bearings, friction laws, drives, loops."""
