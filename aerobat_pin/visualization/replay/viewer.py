"""The viewer of the replay: meshcat's script, with the licences under which others may pass it on."""

from __future__ import annotations

import json
from importlib import resources

from markupsafe import Markup


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
