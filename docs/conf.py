"""Sphinx configuration of the manual.

`python -m sphinx -W --keep-going -b html docs docs/_build` builds it, `-b linkcheck` also asks for the pages of others.
"""

import os
import sys
from pathlib import Path

import platoontraffic

sys.path.insert(0, str(Path(__file__).parent))

project = "platoontraffic"
author = "The platoontraffic developers"
copyright = author
version = release = platoontraffic.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "from_code"]
exclude_patterns = ["_build", "examples", "README.md"]
default_role = "code"
nitpicky = False  # names in signatures are those of numpy and typing, too

myst_enable_extensions = ["deflist"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

autodoc_member_order = "bysource"
autodoc_typehints = "none"

html_theme = "pydata_sphinx_theme"
html_title = "platoontraffic"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_show_sourcelink = False
html_copy_source = False
html_context = {"default_mode": "auto"}  # without it the theme says in the console that it has none
html_theme_options = {
    "logo": {"text": "platoontraffic"},
    "secondary_sidebar_items": ["page-toc"],
    "show_prev_next": True,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
pygments_style = "default"

linkcheck_timeout = 20
linkcheck_ignore = [r"https?://localhost"]
os.environ.setdefault("NUMBA_DISABLE_PERFORMANCE_WARNINGS", "1")
