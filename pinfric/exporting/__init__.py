"""A scene for other engines: constants fitted along a motion, and what each of them costs."""
