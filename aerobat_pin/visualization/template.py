"""The HTML templates in `pages/`, filled with values."""

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
    """Return a page made of a template; values are escaped unless they are `markupsafe.Markup`."""
    return PAGES.get_template(template).render(values)
