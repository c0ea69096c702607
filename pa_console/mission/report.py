"""Step 10: the after-action report of a mission, in a few plain lines (WF-09, WF-10)."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

from pa_console.mission.planning.picture_text import silence
from pa_console.schema.events.event import WorkflowMoved
from pa_console.schema.mission import (
    Alarm,
    AlarmKind,
    Decision,
    Mission,
    MissionStatus,
    Verification,
)
from pa_console.schema.plan import Plan
from pa_console.schema.telemetry import Picture

MOST_NAMED = 8
GAP_WORTH_S = 1.0

CLEARS_WHEN: dict[AlarmKind, str] = {
    "hostile_track": "the threat is over",
    "defiant_track": "the threat is over",
    "unknown_track": "the track is gone, leaves or is known to be harmless",
    "unauthorized_track": "the track is gone or leaves",
    "coverage_lost": "the gate is covered",
    "coverage_unknown": "the gate is known to be covered",
    "asset_failed": "the asset works again",
    "link_lost": "the asset is heard again",
    "suspect_telemetry": "the telemetry is sound again",
    "low_battery": "the asset charges, is on its way to the base, or was taken care of",
    "camera_lost": "the camera works again",
    "way_blocked": "the way is open, or whoever needed it has left",
    "many_contacts": "fewer contacts are reported",
}
"""The kinds of alarms, each with the condition that clears it."""


@dataclass
class PlanFacts:
    """One plan that was carried out; `halted` has the reasons if it did not run to its end.

    `unmet` has the parts of the order that the plan left out, with the reasons.
    """

    plan: Plan
    task: str
    verification: Verification | None = None
    halted: tuple[str, ...] = ()
    decision: Decision | None = None
    unmet: tuple[str, ...] = ()
    step: int = 0
    """The number of the step of a plan in steps, from 1; 0 for a whole plan."""
    steps: int = 0
    held: str = ""
    """The actions that were not sent after this step, or the reason."""


@dataclass
class PlaceWatch:
    """The longest time for which no asset was known to be at a place, in simulated seconds."""

    longest_s: float = 0.0
    _since_s: float | None = None

    def see(self, time_s: float, *, somebody: bool) -> None:
        """Record whether an asset is known to be at the place."""
        if somebody:
            self._since_s = None
            return
        self._since_s = time_s if self._since_s is None else self._since_s
        self.longest_s = max(self.longest_s, time_s - self._since_s)


@dataclass
class ReportFacts:
    """The facts of a mission, recorded as they happen; times are simulated seconds."""

    mission: Mission
    alarm: Alarm | None = None
    rules: tuple[str, ...] = ()
    """The ids of the rules that were retrieved for the mission (WF-10)."""
    warnings: tuple[str, ...] = ()
    """The warnings about the rule set that is in force for the mission."""
    plans: list[PlanFacts] = field(default_factory=list[PlanFacts])
    moves: list[tuple[WorkflowMoved, float]] = field(
        default_factory=list[tuple[WorkflowMoved, float]]
    )
    patrolled: dict[str, PlaceWatch] = field(default_factory=dict[str, PlaceWatch])
    """The places of a patrol, each with the time without an asset."""
    gaps_s: dict[str, float] = field(default_factory=dict[str, float])
    """The longest time for which each gate had no known cover."""
    seen_from_s: float | None = None

    @property
    def count(self) -> int:
        """The number of plans; a plan in steps counts once."""
        return sum(plan.step <= 1 for plan in self.plans)

    @property
    def halts(self) -> tuple[PlanFacts, ...]:
        """The plans that were halted."""
        return tuple(facts for facts in self.plans if facts.halted)

    def moved(self, move: WorkflowMoved, time_s: float) -> None:
        """Record that a workflow advanced."""
        self.moves.append((move, time_s))

    def see(self, picture: Picture) -> None:
        """Record from a new picture how long gates and places have been without an asset."""
        if self.seen_from_s is None:
            self.seen_from_s = picture.time_s
        for place, watch in self.patrolled.items():
            there = (a for a in picture.assets.values() if a.at == place and a.available)
            watch.see(picture.time_s, somebody=any(there))
        for gate, cover in picture.gates.items():
            gap = min(cover.uncovered_s, picture.time_s - self.seen_from_s)
            if gap > self.gaps_s.get(gate, 0.0):
                self.gaps_s[gate] = gap


def after_action_report(
    facts: ReportFacts,
    status: MissionStatus,
    reason: str,
    picture: Picture,
    open_alarms: Sequence[Alarm] = (),
) -> str:
    """Return the report: a mission's cause and actions, the evidence, open tracks and alarms.

    The judge's verdict on the outcome is a separate event, because the judge gives it later.
    """
    mission = facts.mission
    lines = [f"{mission.id} {status}: {mission.said}"]
    if facts.alarm is not None:
        alarm = facts.alarm
        lines.append(f"Raised by {alarm.id} ({alarm.priority}) at {alarm.raised_s:.0f} s: ")
        lines[-1] += alarm.text
    elif mission.alarm:
        lines.append(f"Raised by alarm {mission.alarm}")
    if mission.agent:
        lines.append(f"Proposed by agent {mission.agent} over MCP")
    lines.extend(f"Rule set: {warning}" for warning in facts.warnings)
    if facts.rules:
        lines.append(f"Rules: {', '.join(facts.rules)}")
    lines.extend(_workflows(facts.moves))
    number, several = 0, facts.count > 1
    for plan in facts.plans:
        number += plan.step <= 1
        lines.extend(_plan(plan, f"Plan {number}" if several else "Plan", mission))
    if not facts.plans:
        lines.append(f"Nothing was executed: {reason}")
    elif status != "verified" and reason:
        lines.append(f"Outcome: {reason}")
    lines.extend(_patrol(facts))
    lines.extend(_gates(facts, picture))
    answered = [a for a in open_alarms if a.id == mission.alarm and status == "verified"]
    lines.extend(f"{a.id} is answered; it clears when {CLEARS_WHEN[a.kind]}" for a in answered)
    lines.extend(_open(picture, [alarm for alarm in open_alarms if alarm not in answered]))
    return "\n".join(lines)


def _workflows(moves: Iterable[tuple[WorkflowMoved, float]]) -> Iterator[str]:
    """Yield one line for each workflow: its phases with their times, and its outcome."""
    stories: dict[tuple[str, str], list[str]] = {}
    for move, time_s in moves:
        steps = stories.setdefault((move.workflow, move.track), [move.rule_id])
        if move.phase < len(move.phases) and not move.outcome:
            steps.append(f"{move.phases[move.phase]} from {time_s:.0f} s")
        else:
            steps.append(f"over at {time_s:.0f} s: {move.outcome or 'every phase done'}")
    for (workflow, track), (rule_id, *steps) in stories.items():
        yield f"Workflow {workflow} ({rule_id}) for {track}: {'; '.join(steps)}"


def _plan(facts: PlanFacts, name: str, mission: Mission) -> Iterator[str]:
    if facts.step > 1:
        yield f"Step {facts.step} of {facts.steps}"
        yield from _outcome(facts)
        return
    task = f" for {facts.task!r}" if facts.task != mission.text else ""
    yield f"{name}{task}. Rationale: {facts.plan.reason}"
    if facts.decision is not None:
        why = f", {facts.decision.reason}" if facts.decision.reason else ""
        override = ", the judge overridden" if facts.decision.override_judge else ""
        yield f"Decided by {facts.decision.by}: {facts.decision.kind}{override}{why}"
    yield from (f"Not met: {text}" for text in facts.unmet)
    if facts.step:
        yield f"Step {facts.step} of {facts.steps}"
    yield from _outcome(facts)


def _outcome(facts: PlanFacts) -> Iterator[str]:
    """Yield the outcome of a plan or of one of its steps."""
    if facts.held:
        yield f"Not sent: {facts.held}"
    if facts.halted:
        yield f"Halted: {'; '.join(facts.halted)}"
    seen = facts.verification
    if seen is None:
        yield from (f"- {action.agent} {action.command}" for action in facts.plan.actions)
        return
    for action in seen.actions:
        yield f"- {action.agent} {action.command}: {action.outcome}, {action.reason}"
    yield f"By telemetry as of {seen.as_of_s:.1f} s: {seen.outcome}, {seen.reason}"


def _patrol(facts: ReportFacts) -> Iterator[str]:
    """Yield, for each place of a patrol, its visits and its longest time without an asset."""
    for place, watch in facts.patrolled.items():
        seen = [
            f"{plan.verification.as_of_s:.0f} s"
            for plan in facts.plans
            if plan.verification is not None
            and any(
                action.outcome == "pass" and action.command.endswith(f" {place}")
                for action in plan.verification.actions
            )
        ]
        when = f"seen at {', '.join(seen)}" if seen else "not seen"
        alone = f"nobody there for {watch.longest_s:.0f} s at the longest"
        cover = alone if watch.longest_s >= GAP_WORTH_S else "somebody was always there"
        yield f"Patrol: {place} {when}; {cover}"


def _gates(facts: ReportFacts, picture: Picture) -> Iterator[str]:
    """Yield the cover of the gates; a gate with unknown cover is never called covered."""
    unknown = [gate for gate, cover in picture.gates.items() if cover.unknown]
    bare = [g for g, cover in picture.gates.items() if not cover.covered and not cover.unknown]
    if bare:
        yield f"Uncovered gates: {_some(bare)}"
    if unknown:
        yield f"Gates whose cover is unknown: {_some(unknown)}"
    if not bare and not unknown:
        yield "All gates covered."
    gaps = sorted(facts.gaps_s.items(), key=lambda item: (-item[1], item[0]))
    worth = [f"{gate} {gap:.0f} s" for gate, gap in gaps if gap >= GAP_WORTH_S]
    if worth:
        yield f"Longest without known cover: {_some(worth)}"


def _open(picture: Picture, alarms: Sequence[Alarm]) -> Iterator[str]:
    """Yield the tracks and alarms that remain open, and the assets without a recent report."""
    tracks = sorted(picture.tracks.values(), key=lambda track: (track.distance_m, track.id))
    for track in tracks[:MOST_NAMED]:
        age = f", last seen {picture.time_s - track.stamp_s:.0f} s ago" if track.stale else ""
        identity = f"identity {track.identity}, intent {track.intent}"
        dispute = f", {track.dispute}" if track.dispute else ""
        yield f"Open track: {track.id} at {track.gate}, {identity}{dispute}{age}"
    if len(tracks) > MOST_NAMED:
        yield f"Open tracks beside these: {len(tracks) - MOST_NAMED}"
    if alarms:
        yield f"Open alarms: {_some([f'{alarm.id} {alarm.text}' for alarm in alarms], '; ')}"
    silent = [why for asset in picture.assets.values() if (why := silence(picture, asset))]
    if silent:
        yield f"Unknown: {_some(silent, '; ')}"


def _some(words: Sequence[str], between: str = ", ") -> str:
    more = f"{between}and {len(words) - MOST_NAMED} more" if len(words) > MOST_NAMED else ""
    return between.join(words[:MOST_NAMED]) + more
