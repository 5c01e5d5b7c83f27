"""Settings of the documentation site. The source folder is the repository, so that pages link to code and experiments:

sphinx-build -W --keep-going -c docs . out/site
"""

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

from rpojax.version import __version__  # noqa: E402

project = "rpojax"
author = "The rpojax developers"
copyright = "The rpojax developers, Apache-2.0"
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx_design",
    "site_extensions.gallery",
    "site_extensions.generated_pages",
    "site_extensions.mathml",
    "site_extensions.source_pages",
]
root_doc = "docs/index"
include_patterns = [
    "docs/**.md",
    "experiments/*/README.md",
    "experiments/mismatch/robustness.md",
    "benchmarks/README.md",
    "notebooks/*.ipynb",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
]
exclude_patterns = ["out", "results", "build", "dist", ".venv*", ".git", "**/.ipynb_checkpoints"]

gallery_files = "docs/made"  # folder that make_gallery.py wrote; empty for a site without them

nb_execution_mode = "off"  # notebooks are committed with their results; tests/test_notebooks.py executes them
myst_enable_extensions = ["dollarmath", "deflist", "attrs_inline", "colon_fence"]
myst_heading_anchors = 4
highlight_language = "none"  # blocks without a language are shell commands

html_theme = "furo"
html_title = f"rpojax {release}"
html_static_path = ["static"]
html_extra_path = ["front"]  # leads from the folder of the site to the front page
html_show_search_summary = False  # pages cannot be fetched for a summary without a server
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False

default_role = "code"  # single backquotes in docstrings are code
