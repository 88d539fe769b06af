"""Trajectories: what the joints do over time, read from files, way-points and logs."""
