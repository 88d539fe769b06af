"""Sphinx extension: equations become MathML when the site is built, so no page loads a script.

The converter is docutils' own. A command that it does not know stops the build and is named.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError


def mathml(formula: str, *, block: bool) -> str:
    r"""Return a formula's `<math>` element; a number `\tag{3}` stands behind it, in brackets.

    Args:
        formula: LaTeX. block: on lines of its own.

    Raises:
        ExtensionError: a command is not known.
    """
    inside = re.sub(r"\\(begin|end)\{equation\*\}", "", formula).strip()
    numbered = re.sub(r"\\tag\{([^}]*)\}", r"\\qquad \\text{(\1)}", inside)
    try:
        element = str(latex2mathml.tex2mathml(numbered, as_block=block))
    except MathError as problem:
        raise ExtensionError(f"{formula.strip()!r} has no MathML: {problem}") from None
    # else a browser takes the bars of |x| for an operator between two values
    return element.replace('<mo stretchy="false">|', '<mo stretchy="false" lspace="0" rspace="0">|')


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(mathml(node.astext(), block=False))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math">{mathml(node.astext(), block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
