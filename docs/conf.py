"""The documentation as a site: `make docs` builds it, with every warning an error.

The pages are plain Markdown that reads as well on a code host: links lead to files, and what only the site can do
stands in directives, such as `toctree` and those in `_extensions`.
"""

from __future__ import annotations

import sys
from importlib.metadata import version as installed_version
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_extensions"), str(HERE.parent), str(HERE.parent / "adapters")]

project = "smartplay-tools"
author = "the authors of smartplay-tools"
project_copyright = "the authors of smartplay-tools"
release = installed_version("smartplay-tools")

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx_copybutton"]
extensions += [
    "command_line",
    "example_pages",
    "live_replay",
    "other_pages",
    "public_names",
]  # of our own, in `_extensions`
exclude_patterns = ["_build", "jupyter_execute"]
nitpicky = True
add_module_names = False

myst_heading_anchors = 3
myst_links_external_new_tab = True

# Notebooks are run whenever the site is built, and one that fails fails the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
toc_object_entries_show_parents = "hide"

html_theme = "furo"
html_title = "smartplay-tools"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
