"""Settings of Sphinx. `make docs` builds the site from the pages of this folder and the examples; nothing is fetched,
and the pages load nothing from elsewhere."""

from __future__ import annotations

from importlib.metadata import version as version_of
from pathlib import Path
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert

ROOT = Path(__file__).parents[1]

project = "rpil"
author = "The rpil developers"
version = release = version_of("rpil")

templates_path = ["_templates"]
exclude_patterns = ["_templates"]
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_click",
    "sphinx_gallery.gen_gallery",
]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

autodoc_typehints = "none"  # docstrings have the types
autosummary_generate = True
numpydoc_show_class_members = False

html_theme = "pydata_sphinx_theme"
html_title = "rpil"
html_show_sourcelink = html_copy_source = False
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["site.css"]
smartquotes = False  # they would make one dash of the two of an option
html_theme_options = {"show_prev_next": False, "secondary_sidebar_items": ["page-toc"]}

RUN = ("plot_ranking", "plot_steps", "plot_methods", "plot_step_weights")
"""The examples that are run for the site; the others need torch, and are shown."""

MAX_SIGNATURE = 600
"""Characters; the constructors of estimators have fewer."""

sphinx_gallery_conf = {
    "examples_dirs": [str(ROOT / "examples")],
    "gallery_dirs": ["gallery"],
    "filename_pattern": rf"/({'|'.join(RUN)})\.py$",
    "download_all_examples": False,
    "show_signature": False,
    "abort_on_example_error": True,
    "write_computation_times": False,
}


def visit_math(translator: Any, node: nodes.math | nodes.math_block) -> None:
    """A formula as MathML, which browsers draw without a script."""
    is_block = isinstance(node, nodes.math_block)
    formula = convert(node.astext(), display="block" if is_block else "inline")
    translator.body.append(f'<div class="formula">{formula}</div>' if is_block else formula)
    raise nodes.SkipNode


def shorten_signature(
    app: Any, what: str, name: str, obj: Any, options: Any, signature: str | None, returned: str
) -> Any:
    """No page of defaults before a class that users never make: its attributes are described below."""
    return ("(...)", returned) if signature is not None and len(signature) > MAX_SIGNATURE else None


def setup(app: Any) -> None:
    app.connect("autodoc-process-signature", shorten_signature)
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_math, None))
