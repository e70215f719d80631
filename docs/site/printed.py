"""Pages of what the program prints about itself: its commands, and the keys of a scenario file."""

from __future__ import annotations

import inspect
import re
from typing import Any


def commands_page() -> str:
    """Return a page with every command: what it does, its arguments and options."""
    from typer.main import get_command

    from aerobat_pin.cli.app import app

    group: Any = get_command(app)
    text = "# Commands\n\nAs `aerobat COMMAND --help` prints them, in one place. A mistake ends with exit code 2.\n"
    for name, command in group.commands.items():
        if command.hidden:
            continue
        text += f"\n## `aerobat {name}`\n\n{_words(command.help)}\n\n| argument or option | meaning |\n|---|---|\n"
        for one in command.params:
            if getattr(one, "hidden", False):
                continue
            if one.param_type_name == "argument":
                shown = one.metavar or (one.name.upper() if one.required else f"[{one.name.upper()}]")
            else:
                value = "" if getattr(one, "is_flag", False) else f" {one.metavar or one.name.upper()}"
                shown = ", ".join([*one.opts, *one.secondary_opts]) + value
            text += f"| `{shown}` | {_words(getattr(one, 'help', None)).replace('|', '/')} |\n"
    return text


def scenario_page() -> str:
    """Return a page with every key of a scenario file, as `aerobat describe scenario` prints it."""
    from aerobat_pin.scenario import describe_scenario

    where = "A table or key can be set in the file, or with `--set table.key=value`."
    return f"# Keys of a scenario\n\n{where}\n\n```text\n{describe_scenario().rstrip()}\n```\n"


def _words(text: str | None) -> str:
    """Return a help text as Markdown in a line: options as code, and no sign taken for HTML."""
    parts = " ".join(inspect.cleandoc(text or "").split()).split("`")
    parts[::2] = [re.sub(r"--[a-z][a-z-]*", r"`\g<0>`", part.replace("<", "&lt;")) for part in parts[::2]]
    parts[1::2] = [f"`{part}`" for part in parts[1::2]]
    return "".join(parts)
