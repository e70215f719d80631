"""Fill the templates in `pages/` with values."""

from __future__ import annotations

import base64
import json
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

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


def viewer_script() -> Markup:
    """Return meshcat's viewer as installed, behind a comment with the notices of all that was built into it."""
    folder = resources.files("meshcat") / "viewer"
    notices = ["meshcat\n\n" + (folder / "LICENSE").read_text(encoding="utf-8")]
    parts = folder / "dist" / "main.min.js.THIRD_PARTY_LICENSES.json"
    if parts.is_file():
        for part in json.loads(parts.read_text(encoding="utf-8")):
            notices.append(f"{part['name']} {part['version']}: {part['license']}\n\n{part['licenseText'] or ''}")
    said = "\n\n".join(notices).replace("*/", "* /").replace("</", "< /")
    return Markup(f"/*\n{said}\n*/\n") + Markup((folder / "dist" / "main.min.js").read_text(encoding="utf-8"))


PAGES.filters["base64"] = base64_text
PAGES.globals["viewer_script"] = viewer_script


def fill_template(template: str, **values: Any) -> str:
    """Return a template filled with values; they are HTML-escaped, except `markupsafe.Markup`."""
    return PAGES.get_template(template).render(values)
