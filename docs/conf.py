"""Sphinx configuration of the documentation; `bash scripts/docs.sh` builds it."""

from __future__ import annotations

import sys
from importlib.metadata import version as installed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "extensions"))

project = "gfmdlayer"
author = "The gfmdlayer developers"
copyright = author  # noqa: A001
release = version = installed("gfmdlayer")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "sphinx_copybutton",
    "links",
    "mathml",
    "published_values",
    "reference_pages",
    "thumbnails",
    "verification_run",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
templates_path = ["templates"]
exclude_patterns = [
    "_build",
    "gallery/README.rst",
    "gallery/tasks/README.rst",
    "gallery/examples",
    "extensions",
    "verification/run",
    "benchmarks",
]
nitpicky = False

myst_enable_extensions = ["amsmath", "deflist", "dollarmath"]
myst_heading_anchors = 3
myst_fence_as_directive = ["math"]

autosummary_generate = True
autosummary_ignore_module_all = False
autodoc_typehints = "none"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "examples",
    "filename_pattern": r"/plot_",
    "within_subsection_order": "FileNameSortKey",  # the tasks have numbers
    "abort_on_example_error": True,
    "show_memory": False,
    "download_all_examples": False,
    "show_signature": False,
    "min_reported_time": 10,
    "matplotlib_animations": False,
    "image_scrapers": ("thumbnails.scrape",),
    "show_api_usage": False,
    "write_computation_times": False,
}

html_theme = "furo"
html_title = f"gfmdlayer {version}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_math_renderer = "mathml"
copybutton_exclude = ".linenos, .gp, .go"
