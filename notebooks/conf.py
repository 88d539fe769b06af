"""The documentation site: `pip install -e ".[docs]"`, `sphinx-build -W notebooks build/docs`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # for `from_code` and `mathml`, beside this file

import pinfric  # also: its package, whose docstrings are read

project = "pinfric"
author = copyright = "the authors of pinfric"
version = release = pinfric.__version__
language = "en"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "from_code",
    "mathml",
]
exclude_patterns = ["**/.ipynb_checkpoints"]

# Pages are Markdown and notebooks; these keep their outputs, which the tests hold current.
myst_enable_extensions = ["amsmath", "attrs_block", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"
suppress_warnings = [
    "misc.highlighting_failure",  # cells of `%%writefile` are no Python
    "ref.python",  # fields of several results have one name, as `a`
]

# Every function that a page names must be there; types of attributes need not.
nitpicky = True
nitpick_ignore_regex = [("py:(?!func).*", ".*"), ("py:class", ".*")]

# Docstrings state shapes and units, so signatures need not repeat types.
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
napoleon_numpy_docstring = False
napoleon_use_ivar = True

html_math_renderer = "mathml"
html_theme = "furo"
html_title = "pinfric"
html_static_path = ["static"]
html_css_files = ["pinfric.css"]
html_copy_source = html_show_sourcelink = False
