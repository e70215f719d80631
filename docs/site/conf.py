"""Settings of Sphinx for the site; `build.py` stages the pages and calls it."""

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from reference import escaped
from sphinx.util.math import get_node_equation_number

import aerobat_pin

project = "Aerobat on Pinocchio"
author = "Aerobat on Pinocchio developers"
version = release = aerobat_pin.__version__
copyright = f"{author}, BSD-2-Clause; version {release}"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
highlight_language = "none"
smartquotes = False

myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 4

autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
autodoc_type_aliases = {"Array": "Array", "ArrayLike": "ArrayLike", "Integers": "Integers"}
python_maximum_signature_line_length = 100
toc_object_entries = False  # each page begins with a list of its names
napoleon_use_ivar = True

html_theme = "furo"
html_title = "Aerobat on Pinocchio"
html_math_renderer = "mathml"
html_copy_source = False
html_use_index = False  # api/names has every name, in a line
html_static_path = ["static"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": False, "top_of_page_buttons": []}


def mathml(latex: str, display: str) -> str:
    """Return an equation as MathML, which browsers draw by themselves."""
    known = latex.replace("{aligned}", "{align*}")  # the converter has the one and not the other
    return convert(re.sub(r"\s+", " ", known).strip(), display=display)


def inline_equation(writer: Any, node: nodes.math) -> None:
    """Write an equation within a line."""
    writer.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def block_equation(writer: Any, node: nodes.math_block) -> None:
    """Write an equation on a line of its own, with its number where it has a label."""
    writer.body.append(writer.starttag(node, "div", CLASS="equation"))
    writer.body.append(mathml(node.astext(), "block"))
    if node["number"]:
        writer.body.append(f'<span class="eqno">({get_node_equation_number(writer, node)})</span>')
    writer.body.append("</div>\n")
    raise nodes.SkipNode


def as_written(_app: Any, _what: str, _name: str, _obj: Any, _options: Any, lines: list[str]) -> None:
    """Escape in docstrings what reStructuredText would take for markup: they are plain text with `code`."""
    lines[:] = escaped("\n".join(lines)).split("\n")


def is_field(_app: Any, _what: str, _name: str, obj: Any, _skip: bool, _options: Any) -> bool | None:
    """Leave out the fields of named tuples, which have no docstring of their own."""
    return True if type(obj).__name__ == "_tuplegetter" else None


def setup(app: Any) -> None:
    """Add the renderer of equations, and the reading of docstrings."""
    app.add_html_math_renderer("mathml", (inline_equation, None), (block_equation, None))
    app.connect("autodoc-process-docstring", as_written, priority=400)
    app.connect("autodoc-skip-member", is_field)
