"""The effects of a rule in a session, each with its event, and the rules behind a decision."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.rule import RuleHit
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.session.mission_trace import Attempt, MissionTrace

_NAME = re.compile(r"[\w-]+")

RuleDeed = Literal[
    "retrieved", "decided", "broken", "not applicable", "judged", "blocked", "acknowledged",
    "refused", "sent back", "halted", "prescribed",
]  # fmt: skip
BREAKING: tuple[RuleDeed, ...] = ("broken", "blocked", "refused", "sent back", "halted")
"""The effects that mean that the rule was broken, or that it prevented something."""


@dataclass(frozen=True)
class DecisionEvidence:
    """The basis of the decision on a plan: the picture's tick and time, in simulated seconds.

    `deciding` are the findings against the plan, or, if there are none, the rules that it complies
    with. `facts` are lines of telemetry, one for each asset, track and gate that the plan or a
    finding names.
    """

    tick: int
    time_s: float
    deciding: tuple[Finding, ...]
    facts: tuple[tuple[str, str], ...]


def evidence_of(attempt: Attempt) -> DecisionEvidence | None:
    """Return the basis of the decision on an attempt; None if it was not rehearsed."""
    if attempt.rehearsal is None or attempt.plan is None:
        return None
    picture = attempt.rehearsal.before
    broken = tuple(finding for finding in attempt.findings if finding.broken)
    held = tuple(finding for finding in attempt.findings if finding.status == "complies")
    texts = [f"{action.agent} {action.command}" for action in attempt.plan.actions]
    texts += [finding.message for finding in broken]
    named = dict.fromkeys(name for text in texts for name in _NAME.findall(text))
    facts = dict(fact for name in named for fact in _facts(name, picture))
    return DecisionEvidence(picture.tick, picture.time_s, broken or held, tuple(facts.items()))


def _facts(name: str, picture: Picture) -> Iterator[tuple[str, str]]:
    """Yield the telemetry of an asset or a track, or of a gate and each track there."""
    if name in picture.assets:
        yield name, _asset(picture.assets[name], picture.time_s)
    elif name in picture.tracks:
        yield name, _track(picture.tracks[name], picture.time_s)
    elif name in picture.gates:
        cover = picture.gates[name]
        by = f"covered by {', '.join(cover.by)}" if cover.covered else "not covered"
        there = [track for track in picture.tracks.values() if track.gate == name]
        yield name, f"{by}; tracks: {', '.join(track.id for track in there) or 'none'}"
        yield from ((track.id, _track(track, picture.time_s)) for track in there)


def _asset(asset: AssetTelemetry, now_s: float) -> str:
    parts = [
        f"at {asset.at or 'no frame'}",
        asset.status,
        asset.task,
        f"battery {asset.charge}",
        f"link {asset.comms}",
        *(["stale"] if asset.stale else []),
        *(["suspect"] if asset.integrity != "ok" else []),
        f"report {now_s - asset.stamp_s:.1f} s old",
    ]
    return ", ".join(parts)


def _track(track: Track, now_s: float) -> str:
    parts = [
        f"{track.status} at {track.gate}",
        f"identity {track.identity}",
        *([track.dispute] if track.dispute else []),
        f"intent {track.intent}",
        "observed" if track.observed else "not observed",
        "warned" if track.warned else "not warned",
        *(["emergency vehicle"] if track.emergency else []),
        *(["noncombatants suspected"] if track.noncombatants else []),
        f"last detected {now_s - track.stamp_s:.1f} s earlier",
    ]
    return ", ".join(parts)


@dataclass(frozen=True)
class RuleUse:
    """The use of one rule in one mission.

    `decided` lists the attempts that the rule's check decided on, with the findings; `prescribed`
    lists the tracks whose workflow the rule prescribes. A mission that the rule `refused` was never
    planned.
    """

    mission: str
    text: str
    hit: RuleHit | None = None
    decided: tuple[tuple[int, Finding], ...] = ()
    prescribed: tuple[str, ...] = ()
    refused: bool = False

    @property
    def broken(self) -> bool:
        """True if a plan or the words of the mission broke the rule."""
        return any(finding.broken for _, finding in self.decided)


def uses_of(rule_id: str, missions: Iterable[MissionTrace]) -> tuple[RuleUse, ...]:
    """Return the uses of `rule_id`, in the order of `missions`."""
    return tuple(use for trace in missions if (use := _use(rule_id, trace)) is not None)


def _use(rule_id: str, trace: MissionTrace) -> RuleUse | None:
    hit = next((hit for hit in trace.hits if hit.rule_id == rule_id), None)
    decided = tuple(_decided(rule_id, trace))
    tracks = (move.track for move in trace.workflow if move.rule_id == rule_id)
    prescribed = tuple(dict.fromkeys(tracks))
    if hit is None and not decided and not prescribed:
        return None
    blocked = any(finding.blocking for _, finding in decided)
    refused = trace.status == "refused" and blocked and not trace.hits
    return RuleUse(trace.mission.id, trace.mission.text, hit, decided, prescribed, refused)


def _decided(rule_id: str, trace: MissionTrace) -> Iterator[tuple[int, Finding]]:
    for attempt in trace.attempts:
        for finding in attempt.findings:
            if finding.rule_id == rule_id and finding.status not in (
                "not_applicable",
                "judged_only",
            ):
                yield attempt.number, finding


@dataclass(frozen=True)
class TrailEntry:
    """One effect of a rule in a mission; `event` counts the session's events from 1.

    retrieved       the models were shown the rule, with the score in `words`
    decided         its check held for a plan
    broken          its check failed, or could not be decided
    not applicable  its guard excluded the plan
    judged          the judge gave an opinion on it
    blocked         the plan could not be approved because of it
    acknowledged    the operator acknowledged that it is broken
    refused         the mission was refused at intake because of it
    sent back       the planner had to try again because of it
    halted          a running plan was halted because of it
    prescribed      its workflow moved to the next step for a track

    `attempt` is 0 for an effect that does not concern a single plan.
    """

    event: int
    tick: int
    attempt: int
    did: RuleDeed
    words: str = ""


@dataclass(frozen=True)
class Trail:
    """The effects of a rule in one mission, in order."""

    session: str
    mission: Mission
    entries: tuple[TrailEntry, ...]

    def did(self, *deeds: RuleDeed) -> bool:
        """Return True if any of these effects is among the entries."""
        return any(entry.did in deeds for entry in self.entries)


def trail_of(rule_id: str, events: Iterable[ev.Event]) -> list[Trail]:
    """Return the missions of a session in which `rule_id` had an effect, in order."""
    session = ""
    missions: dict[str, Mission] = {}
    entries_by_mission: dict[str, list[TrailEntry]] = {}
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
            entries_by_mission.setdefault(event.mission, []).append(entry)
    return [
        Trail(session, missions[name], tuple(entries))
        for name, entries in entries_by_mission.items()
    ]


def _entries(
    rule_id: str, mission: str, data: ev.EventPayload, planned: set[tuple[str, int]]
) -> Iterator[tuple[int, RuleDeed, str]]:
    """Yield the attempt, the effect and the words of each mention of the rule in one event."""
    match data:
        case ev.RulesRetrieved(hits=hits):
            for place, hit in enumerate(hits, start=1):
                if hit.rule_id == rule_id:
                    pinned = ", pinned" if hit.pinned else ""
                    yield 0, "retrieved", f"rank {place}, score {hit.score:.3f}{pinned}"
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
        case ev.StepsHeld(attempt=attempt, reason=reason) if f" {rule_id}: " in reason:
            yield attempt, "halted", reason
        case ev.WorkflowMoved(rule_id=of, track=track, command=command, outcome=outcome):
            if of == rule_id:
                yield 0, "prescribed", f"{track}: {command or outcome}"
        case _:
            pass


def _did(finding: Finding) -> RuleDeed:
    if finding.status == "not_applicable":
        return "not applicable"
    return "broken" if finding.broken else "decided"


def _about(rule_id: str, reasons: Iterable[str]) -> Iterator[str]:
    """Yield the reasons that begin with the rule's id, without the id."""
    for reason in reasons:
        if reason.startswith(f"{rule_id}: "):
            yield reason.removeprefix(f"{rule_id}: ")
