"""Fill the templates in `pages/` with values."""

from __future__ import annotations

from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

PAGES = Environment(
    loader=PackageLoader("aerobat_pin.visualization", "pages"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def fill_template(template: str, **values: Any) -> str:
    """Return a template filled with values; they are HTML-escaped, except `markupsafe.Markup`."""
    return PAGES.get_template(template).render(values)
