"""Fill the templates in `pages/` with values."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

PAGES = Environment(
    loader=PackageLoader("aerobat_pin.visualization", "pages"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def base64_text(content: bytes | Path) -> str:
    """Return bytes, or the content of a file, as text that a page can hold; also a filter of the templates."""
    return base64.b64encode(content if isinstance(content, bytes) else content.read_bytes()).decode("ascii")


PAGES.filters["base64"] = base64_text


def fill_template(template: str, **values: Any) -> str:
    """Return a template filled with values; they are HTML-escaped, except `markupsafe.Markup`."""
    return PAGES.get_template(template).render(values)
