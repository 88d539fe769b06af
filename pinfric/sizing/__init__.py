"""Sizing: what a cycle demands of each drive, and which drives of a catalogue meet it.

Takes: a scene, a duty of cycles, a catalogue and conditions; without a catalogue only the demand.

Steps: `size` computes the cycle's efforts, reduces them for each joint (`drives`), ranks all drives
of the catalogue from tip to base, puts their masses in and repeats until no choice changes, then
judges the whole arm, its bus and its stops.

A drive is entries of the catalogue, then figures that rows of limits read, many drives as arrays or
one by numbers (`Candidates`). One that is judged also has its parts and losses (`Candidate`) and
its criteria (`Assessment`), which a report prints.

Gives: `SizingReport`; `sizing_summary` describes it for JSON, terminal and page.
"""
