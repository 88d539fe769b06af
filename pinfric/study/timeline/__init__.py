"""What a motion's friction does over time: frames, spans, and the motion that is shown."""
