"""Sizing: what a cycle demands of each drive, and which drives of a catalogue meet it.

Takes: a scene, a duty of cycles, a catalogue and conditions; without a catalogue only the demand.

Steps: `size` reduces the cycle's efforts for each joint (`drives`), chooses drives from tip to
base, puts their masses in and repeats until no choice changes, then judges the whole arm, its bus
and its stops.

A drive is entries of the catalogue (`Candidate`) and the figures that rows of limits read, of many
drives as arrays or of one as numbers (`Candidates`). Judged, it has criteria (`Assessment`).

Gives: `SizingReport`; `sizing_summary` describes it for JSON, terminal and page.
"""
