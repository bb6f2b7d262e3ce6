"""Settings of the site: `sh scripts/docs` builds it, without a network and with warnings as errors."""

import logging
import sys
from importlib.metadata import version as installed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_site"))

from sphinx_gallery.sorting import FileNameSortKey

project = "QPAL"
author = "the authors of QPAL"
copyright = "2026, the authors of QPAL. Apache-2.0"
release = version = installed("qpal")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "formulas",  # those below are in _site
    "docstrings",
    "reference",
    "imperfections",
    "closed",
]
# A pattern in a list of pages may match none yet; this warning has no type by which Sphinx could leave it out.
logging.getLogger("sphinx.sphinx.directives.other").addFilter(lambda r: getattr(r, "subtype", "") != "empty_glob")
exclude_patterns = ["_site", "gallery/*.rst", "generated/imperfections", "search.md"]  # search.html searches
suppress_warnings = [
    "config.cache",  # the gallery's settings are objects
    "ref.python",  # a short name in a signature may stand for two objects
]

myst_enable_extensions = ["dollarmath", "deflist"]
smartquotes_action = "qe"  # an option keeps its two hyphens
myst_heading_anchors = 4  # links to headings, as on GitHub
html_math_renderer = "mathml"

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 90
autosummary_generate = False

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "generated/gallery",
    "filename_pattern": r"/[a-z_]+\.py$",
    "within_subsection_order": FileNameSortKey,
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_signature": False,
    "capture_repr": (),
    "min_reported_time": 1e9,
    "image_scrapers": ("matplotlib",),
    "reset_modules": ("matplotlib", "gallery_look.apply"),
    "write_computation_times": False,
}

html_theme = "furo"
html_title = "QPAL"
html_static_path = ["_site/static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True}
copybutton_prompt_text = "$ "
