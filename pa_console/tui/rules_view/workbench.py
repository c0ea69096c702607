"""The tools by which one console edits one rule file, shared by browser and editor."""

from collections.abc import Awaitable, Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from pa_console.evaluation.rule_trials import SessionCases
from pa_console.schema.rule import RulesSeal
from pa_console.schema.world import World
from pa_console.session.mission_trace import MissionTrace
from pa_console.tui.kept_input import Drafts


@dataclass
class Workbench:
    """Lets one console edit one rule file; `closed` says why it may not, empty when it may.

    `drafts` are what was typed and not saved, by rule id, '' for a new rule; they outlive the
    editor and the console. `saved` is awaited after the file was written, so that it is taken at
    once. `offered` says why the rules in the file wait to be accepted, empty when they do not, and
    `accept` takes them.
    """

    world: World
    path: Path | None
    closed: str
    seal: Callable[[], RulesSeal]
    missions: Callable[[], Iterable[MissionTrace]]
    busy: Callable[[], str]
    saved: Callable[[], Awaitable[None]]
    offered: Callable[[], str]
    accept: Callable[[], Awaitable[None]]
    cases: SessionCases = field(init=False)
    drafts: Drafts = field(default_factory=Drafts)

    def __post_init__(self) -> None:
        """Begin with an empty session."""
        self.cases = SessionCases(self.world)
