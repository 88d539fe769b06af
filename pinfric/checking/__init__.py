"""What is implausible about a robot or a scene."""
