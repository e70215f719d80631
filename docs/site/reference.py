"""Pages of the reference: every public name of every room's door, from its docstring."""

import importlib
import inspect
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
INNER = ["aerobat_pin.aerobat.raw"]  # doors within a room that users enter, too


def doors() -> list[str]:
    """Return the modules whose public names the reference shows: the front door first, then every room, by name."""
    rooms = [f"aerobat_pin.{path.parent.name}" for path in (ROOT / "aerobat_pin").glob("*/__init__.py")]
    return ["aerobat_pin", *sorted(rooms + INNER), "aerobat_description"]


def names_page() -> str:
    """Return the page of all public names from A to Z: what each is, the doors that give it, and a link."""
    found: dict[str, list[str]] = {}
    for door in doors():
        for name in importlib.import_module(door).__all__:
            found.setdefault(name, []).append(door)
    title = "All public names"
    lines = [title, "=" * len(title), "", "Each leads to its signature and its docstring.", ""]
    for name, given in sorted(found.items(), key=lambda item: (item[0].lower(), item[0])):
        places = ", ".join(f"``{one}``" for one in given)
        lines.append(f"* :py:obj:`{name} <{given[-1]}.{name}>` {places}{summary(given[-1], name)}")
    return "\n".join(lines) + "\n"


def summary(door: str, name: str) -> str:
    """Return a colon and the remark on a value, or the first line of a docstring; nothing where there is none."""
    thing = getattr(importlib.import_module(door), name)
    said = remark(door, name) if is_value(name, thing) else (inspect.getdoc(thing) or "").partition("\n")[0]
    return f": {escaped(said)}" if said else ""


def remark(door: str, name: str) -> str:
    """Return the comment that stands behind the definition of a value in its room."""
    folder = ROOT.joinpath(*door.split("."))
    for file in sorted(folder.rglob("*.py")):
        if found := re.search(rf"^{name}\b(?:: [^=\n]+)? = .*?  # (.*)$", file.read_text("utf-8"), re.MULTILINE):
            return found[1]
    return ""


def is_value(name: str, thing: Any) -> bool:
    """Return whether a name is a value or the name of a type, rather than a class or a function."""
    known = inspect.isclass(thing) and getattr(thing, "__name__", "") == name
    return not (known or inspect.isroutine(thing) or hasattr(thing, "py_func"))


def directive(door: str, name: str, thing: Any) -> list[str]:
    """Return the lines that document one name."""
    target = f"{door}.{name}"
    if is_value(name, thing):
        value = [f"   :value: {thing!r}"] if len(repr(thing)) < 90 and " at 0x" not in repr(thing) else []
        keys = "Keys: " + ", ".join(f"`{key}`" for key in thing) if isinstance(thing, dict) else ""
        note = remark(door, name) or keys
        return [f".. py:data:: {name}", f"   :module: {door}", *value, "", f"   {escaped(note)}", ""]
    if inspect.isclass(thing):
        kind = "autoexception" if issubclass(thing, BaseException) else "autoclass"
        bases = [] if thing.__bases__ == (object,) else ["   :show-inheritance:"]
        return [f".. {kind}:: {target}", "   :members:", *bases, ""]
    return [f".. autofunction:: {target}", ""]


def door_page(door: str) -> str:
    """Return the page of one door: what the room is, a list of its names, then one entry for each.

    The front door's names are those of rooms, and lead there.
    """
    module = importlib.import_module(door)
    names = sorted(module.__all__, key=lambda name: (name.isupper(), name.lower()))
    rooms = {name: f"aerobat_pin.{room}" for room, given in getattr(module, "_ROOMS", {}).items() for name in given}
    lines = [f"``{door}``", "=" * (len(door) + 4), "", f".. automodule:: {door}", ""]
    for name in names:
        lines += [f"* :py:obj:`{name} <{rooms.get(name, door)}.{name}>`{summary(door, name)}"]
    lines += [""]
    for name in names:
        if name not in rooms:
            lines += directive(door, name, getattr(module, name))
    return "\n".join(lines) + "\n"


def escaped(text: str) -> str:
    """Return plain text with `code` as reStructuredText, which would take more signs for markup."""
    parts = re.split(r"`+([^`]+)`+", text)
    parts[::2] = [re.sub(r"(?<=\w)_(?!\w)|[*|\\]", r"\\\g<0>", part) for part in parts[::2]]
    parts[1::2] = [f"``{part}``" for part in parts[1::2]]
    parts[2::2] = [f"\\ {part}" if part[:1].isalnum() else part for part in parts[2::2]]
    return "".join(parts)
