"""The command-line options of a console."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Asked:
    """What a console was started with; `resume` is None where the operator is to be asked."""

    world: str
    rules: str
    scenario: str | None
    seed: int
    alarms: bool
    readonly: bool
    unsigned: bool
    accept_rules: bool
    resume: bool | None
    fleet: str = ""
    certificates: Path | None = None
