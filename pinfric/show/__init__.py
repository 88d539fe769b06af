"""Showing: pictures, tables, pages and replay of results.

Takes: a result of any room; nothing here computes what a result does not have.

Steps: `report` makes tables for the terminal of described rows (`table_of`); `figure` draws with
matplotlib; the pages put both into one HTML file; `timeline` and `replay` show a motion in 3D.

Gives: text, figures and files; `views` is behind `plot` and `summary` of results.
"""
