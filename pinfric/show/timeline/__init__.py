"""Friction of a motion over time: frames, spans, and the motion shown."""
