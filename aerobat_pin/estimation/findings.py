"""What a check found about a record: a measured figure and a verdict."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from aerobat_pin.errors import LogError

UNTESTED, LOST_SAMPLES = "untested forces", "lost samples"  # names of checks, whose words the verdict repeats
WOULD_LOOK = "a wrong sign, order, mass, mounting or friction would look like this force"
FindingVerdict = Literal["good", "note", "warning", "refused"]


@dataclass(frozen=True)
class Finding:
    """One line of the report.

    Attributes:
        check: name of the check, such as `gyro against attitude`.
        verdict: `good`, `note` (a figure without judgement), `warning`, or `refused` (certainly wrong).
        text: the measured figure in words.
        value: the figure.
        unit: its unit.
    """

    check: str
    verdict: FindingVerdict
    text: str
    value: float | None = None
    unit: str = ""

    @property
    def warns(self) -> bool:
        """Whether it spoils the estimate."""
        return self.verdict in ("warning", "refused")

    def __str__(self) -> str:
        return f"{self.check}: {self.text}"


def refuse_if_certain(log: str, findings: Iterable[Finding]) -> None:
    """Raise LogError with all findings that are certainly wrong."""
    certain = [str(finding) for finding in findings if finding.verdict == "refused"]
    if certain:
        raise LogError(f"log {log}: {'; '.join(certain)}; --trust estimates nevertheless")
