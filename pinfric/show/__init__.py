"""Pictures, tables, pages and replays of results; nothing here computes what a result lacks.

Takes: a result of any room.

Steps: `report` makes tables from described rows (`table_of`); `figure` draws with matplotlib;
`pages` put both into one HTML file; `timeline` and `replay` show a motion in 3D.

Gives: text, figures and files; `views` is behind `plot` and `summary` of results.
"""
