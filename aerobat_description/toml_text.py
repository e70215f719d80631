"""Read TOML of a stranger, from a file or a text: size, depth and length of words are checked before parsing.

The parser of the standard library calls itself for each level of nesting, and Python refuses numbers of many digits;
both would end in a traceback. The limits are far above anything that a file of this project needs.
"""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path
from typing import Any

LARGEST_TOML = 1_000_000  # the largest shipped file has 20,000
MOST_LEVELS = 32  # of brackets, and of the parts of a dotted key
LONGEST_WORD = 255  # characters of a key, and digits of a number
# A string, a comment, too long a word, or a sign that counts; a string that does not end goes to the end of its line.
TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?(?:"{3,5}|\Z)|\'\'\'.*?(?:\'{3,5}|\Z)|'
    r'"(?:\\.|[^"\\\n])*"?|\'[^\'\n]*\'?|#[^\n]*|'
    rf"(?<![\w+-])[\w+-]{{{LONGEST_WORD + 1},}}|[][{{}}.=,\n]",
    re.DOTALL,
)
NUL = re.compile(r"(?<!\\)(?:\\\\)*\\(?:u0{4}|U0{8})")  # no file, frame or column can have it in its name


class TomlError(ValueError):
    """A file or a text is not TOML, or is larger or nests deeper than it may. The message says what was expected."""


def toml_file(path: Path) -> dict[str, Any]:
    """Read a TOML file. Raises TomlError if there is no such file, or it cannot be read, is too large or not TOML."""
    if not os.path.isfile(path):  # False also for names that are too long, which `Path.is_file` raises an error for
        raise TomlError("there is no such file")
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_TOML + 1)
        if len(content) > LARGEST_TOML:
            raise TomlError(f"{path.stat().st_size} bytes: at most {LARGEST_TOML} were expected")
        return toml_values(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise TomlError(f"cannot be read: {error}; UTF-8 was expected") from error
    except OSError as error:
        raise TomlError(f"cannot be read: {error.strerror}") from error


def toml_values(text: str) -> dict[str, Any]:
    """Return the values of TOML text. Raises TomlError if it is not TOML, too large or deep, or has long words, NUL."""
    if len(text) > LARGEST_TOML:
        raise TomlError(f"{len(text)} characters: at most {LARGEST_TOML} were expected")
    _check_limits(text)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise TomlError(f"not valid TOML: {error}") from error


def _check_limits(text: str) -> None:
    """Raise TomlError if a word is too long, a text has a NUL, or brackets or dotted keys have too many levels."""
    line, brackets, parts = 1, 0, 0
    for match in TOKEN.finditer(text):
        token = match[0]
        first = token[0]
        if first in "[{":
            brackets, parts = brackets + 1, 0
        elif first in "]}":
            brackets, parts = brackets - 1, 0
        elif first == ".":
            parts += 1
        elif first in "=,\n#":
            parts = 0
        elif first == '"' and NUL.search(token):
            raise TomlError(f"line {line}: a text with the character U+0000")
        elif first not in "\"'" and len(token) > LONGEST_WORD:
            raise TomlError(f"line {line}: a word of {len(token)} characters: at most {LONGEST_WORD} were expected")
        if max(brackets, parts) > MOST_LEVELS:
            raise TomlError(f"line {line}: more than {MOST_LEVELS} levels of brackets or of a dotted key")
        line += token.count("\n")
