"""Print the lower bound of every requirement of the project and its tests as a constraint for pip: `NAME==VERSION`."""

import re
import tomllib
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2] / "pyproject.toml"


def lowest(text: str) -> list[str]:
    """Return the constraints of a `pyproject.toml`."""
    project = tomllib.loads(text)["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["test"]]
    return [re.sub(r"(\[\w+\])?>=([^,]+).*", r"==\2", requirement) for requirement in wanted]


if __name__ == "__main__":
    print("\n".join(lowest(PROJECT.read_text(encoding="utf-8"))))
