"""From a rule to what it did: where a session retrieved, decided, broke or answered it, in order.

Everything is taken from the events as they were logged, so that each entry names its event.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from pa_console.schema import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission

Did = Literal[
    "retrieved", "decided", "broken", "not applicable", "judged", "blocked", "acknowledged",
    "refused", "sent back", "halted", "prescribed",
]  # fmt: skip
BREAKING: tuple[Did, ...] = ("broken", "blocked", "refused", "sent back", "halted")
"""What says that the rule was broken, or kept something from being done."""


@dataclass(frozen=True)
class TrailEntry:
    """One thing that a rule did in a mission; `event` counts the session's events from 1.

    retrieved       the models were shown it, `words` say with what score
    decided         its check held for a plan
    broken          it did not, or could not be decided
    not applicable  its guard left the plan out
    judged          the judge gave an opinion on it
    blocked         because of it nobody could approve the plan
    acknowledged    the operator accepted that it is broken
    refused         because of it the mission was refused at intake
    sent back       the planner was told of it and had to try again
    halted          because of it a running plan was brought to a safe state
    prescribed      its workflow took a track a step further

    `attempt` is 0 for what concerns no single plan.
    """

    event: int
    tick: int
    attempt: int
    did: Did
    words: str = ""


@dataclass(frozen=True)
class Trail:
    """What a rule did in one mission, in order."""

    session: str
    mission: Mission
    entries: tuple[TrailEntry, ...]

    def did(self, *what: Did) -> bool:
        """Return whether any of these happened."""
        return any(entry.did in what for entry in self.entries)


def trail_of(rule_id: str, events: Iterable[ev.Event]) -> list[Trail]:
    """Return the missions of a session in which `rule_id` did anything, in order."""
    session = ""
    missions: dict[str, Mission] = {}
    found: dict[str, list[TrailEntry]] = {}
    planned: set[tuple[str, int]] = set()
    for number, event in enumerate(events, start=1):
        match event.data:
            case ev.SessionStarted():
                session = event.data.session
            case ev.MissionReceived(mission=mission):
                missions[mission.id] = mission
            case ev.PlanProposed(attempt=attempt):
                planned.add((event.mission or "", attempt))
            case _:
                pass
        if event.mission not in missions:
            continue
        for attempt, did, words in _entries(rule_id, event.mission, event.data, planned):
            entry = TrailEntry(number, event.tick, attempt, did, words)
            found.setdefault(event.mission, []).append(entry)
    return [Trail(session, missions[name], tuple(entries)) for name, entries in found.items()]


def _entries(
    rule_id: str, mission: str, data: ev.EventPayload, planned: set[tuple[str, int]]
) -> Iterator[tuple[int, Did, str]]:
    """Yield attempt, what the rule did, and the words of one event."""
    match data:
        case ev.RulesRetrieved(hits=hits):
            for place, hit in enumerate(hits, start=1):
                if hit.rule_id == rule_id:
                    pinned = ", pinned" if hit.pinned else ""
                    yield 0, "retrieved", f"place {place}, score {hit.score:.3f}{pinned}"
        case ev.PlanChecked(attempt=attempt, findings=findings):
            for finding in findings:
                if finding.rule_id == rule_id and finding.status != "judged_only":
                    refused = finding.blocking and (mission, attempt) not in planned
                    yield attempt, "refused" if refused else _did(finding), finding.message
        case ev.PlanJudged(attempt=attempt, verdict=verdict) if verdict is not None:
            for opinion in verdict.rules:
                if opinion.rule_id == rule_id:
                    yield attempt, "judged", f"{opinion.opinion}; {verdict.verdict}"
        case ev.RepairRequested(attempt=attempt, reasons=reasons):
            for text in _about(rule_id, reasons):
                yield attempt, "sent back", text
        case ev.ApprovalRequested(attempt=attempt, blocked_by=reasons):
            for text in _about(rule_id, reasons):
                yield attempt, "blocked", text
        case ev.DecisionMade(attempt=attempt, decision=decision, accepted=True):
            if rule_id in decision.acknowledged and decision.kind == "approve":
                yield attempt, "acknowledged", f"by {decision.by}: {decision.reason}"
        case ev.PlanHalted(attempt=attempt, reasons=reasons):
            for text in _about(rule_id, reasons):
                yield attempt, "halted", text
        case ev.WorkflowMoved(rule_id=of, track=track, command=command, outcome=outcome):
            if of == rule_id:
                yield 0, "prescribed", f"{track}: {command or outcome}"
        case _:
            pass


def _did(finding: Finding) -> Did:
    if finding.status == "not_applicable":
        return "not applicable"
    return "broken" if finding.broken else "decided"


def _about(rule_id: str, reasons: Iterable[str]) -> Iterator[str]:
    """Yield the reasons that name the rule, as `ID: words`."""
    for reason in reasons:
        if reason.startswith(f"{rule_id}: "):
            yield reason.removeprefix(f"{rule_id}: ")
