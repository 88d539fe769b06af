"""Tables of cases as text: a row a line, its columns two spaces or more apart."""

import re

import numpy as np


def table(text, *kinds):
    """The rows of a table for `parametrize`, each column as its kind makes it, text by default."""
    rows = [re.split(r" {2,}", line.strip()) for line in text.strip().splitlines()]
    kinds = kinds or (str,) * len(rows[0])
    return [tuple(kind(x) for kind, x in zip(kinds, row, strict=True)) for row in rows]


def arguments(text, **names):
    """Keyword arguments as they are typed in Python, with `np` and other names."""
    return eval(f"dict({text})", {"np": np, **names})
