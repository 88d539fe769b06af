"""Motor sizing: what a cycle demands of each drive, and which drives of a catalogue meet it."""
