"""The current work on one line: a mission's running step, and the reading of a typed order.

A step is shown with its time so far and its usual time, in seconds of the caller's clock; a replay
shows neither. The reading of an order that is still being typed is never an approval.
"""

import json
from collections import defaultdict, deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from statistics import median

from pa_console.language.canonical.reading import listed, place_words, plain_reading
from pa_console.private_files import make_private_folder, replace_private
from pa_console.schema.command import COMMANDS
from pa_console.schema.events import event as ev
from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.text import count, duration_text
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState
from pa_console.views.event_words import trigger_in_words

WORK = {
    "retrieve": "reading the order and finding its rules",
    "picture": "reading the picture",
    "prompt": "writing the prompt",
    "plan": "the model writes the plan",
    "safeguards": "the plan is checked and rehearsed",
    "judge": "the judge reads the plan",
    "read_again": "the second reader reads the order",
    "readings": "the readings of the order are compared",
    "execute": "the assets carry out the plan",
    "verify": "telemetry is compared with the plan",
    "report": "the report is written",
}
"""The line for each stage that runs without the operator."""

SHOWN_AFTER_S = 0.3
"""Seconds before a step is shown, because a shorter step ends before its name can be read."""

LONG = 2.0
"""The multiple of its usual time after which a step is shown as taking longer."""

_REMEMBERED = 20
_LEAST = 3
"""The minimum number of measured durations for their median to count as the usual time."""
_CHARACTERS = 3.5
"""Characters per token, assumed until an answer reports its number of tokens."""

NOT_UNDERSTOOD = "not understood: "
MOST_STEPS = 4
"""The number of a plan's steps that are shown; the others are only counted."""


class Waiting:
    """A clock for the steps of the active mission; `usual` maps steps to seconds, if known."""

    def __init__(self, usual: Mapping[str, float] | None = None) -> None:
        stored = (usual or {}).items()
        self._stored = {step: taken for step, taken in stored if taken >= SHOWN_AFTER_S}
        self._taken: defaultdict[str, deque[float]] = defaultdict(lambda: deque(maxlen=_REMEMBERED))
        self._step: tuple[str, str] | None = None
        self._since = 0.0
        self._written = 0
        self._characters, self._tokens = 0, 0
        self._after_judge = ""
        """The step that follows the judge's verdict; '' before the verdict."""

    def take(self, event: ev.Event, state: SessionState, now: float) -> None:
        """Process an event, already applied to `state`, at time `now`."""
        match event.data:
            case ev.TextStreamed(text=text):
                self._written += len(text)
            case ev.PlanProposed(text=text, usage=usage) if usage.completion_tokens:
                self._characters += len(text)
                self._tokens += usage.completion_tokens
            case ev.PromptBuilt():
                self._after_judge = ""
            case ev.PlanJudged():
                self._after_judge = "read_again"
            case ev.OrderReadAgain():
                self._after_judge = "readings"
            case _:
                pass
        step = self._active_step(state)
        if step == self._step:
            return
        waited = now - self._since >= SHOWN_AFTER_S
        if waited and self._step is not None and step is not None and self._step[0] == step[0]:
            self._taken[self._step[1]].append(now - self._since)
        self._step, self._since, self._written = step, now, 0

    def _active_step(self, state: SessionState) -> tuple[str, str] | None:
        trace = state.missions.get(state.active or "")
        if trace is None:
            return None
        step = (self._after_judge or "judge") if trace.stage == "judge" else trace.stage
        return trace.mission.id, step

    def usual_s(self, step: str) -> float | None:
        """Return the usual seconds of `step`, as measured or stored; None if unknown."""
        taken = self._taken.get(step, ())
        if len(taken) >= _LEAST or (taken and step not in self._stored):
            return median(taken)
        return self._stored.get(step)

    @property
    def usual(self) -> dict[str, float]:
        """The usual seconds of every known step, to be saved for the next session."""
        steps = {*self._stored, *self._taken}
        return {
            step: round(taken, 3)
            for step in sorted(steps - {"execute"})
            if (taken := self.usual_s(step)) is not None
        }

    @property
    def tokens(self) -> int:
        """The approximate number of tokens of the current answer so far."""
        characters_per_token = self._characters / self._tokens if self._tokens else _CHARACTERS
        return round(self._written / characters_per_token)

    def line(self, now: float, state: SessionState, rate: float = 1.0) -> str:
        """Return the running step, its time so far and its usual time; '' if none runs.

        The usual time of a plan's execution is that of its rehearsal, at `rate` simulated seconds
        per second.
        """
        if state.worker is not None and state.worker.state == "loading" and state.active:
            return "the model is being loaded"
        if self._step is None or self._step[1] not in WORK:
            return ""
        elapsed = now - self._since
        if elapsed < SHOWN_AFTER_S:
            return ""
        step = self._step[1]
        if step == "execute":
            usually = _rehearsed(state, rate)
        else:
            usual = self.usual_s(step)
            usually = _compared(elapsed, usual) if usual is not None else ""
        written = f", {self.tokens} tokens" if self._written else ""
        return f"{WORK[step]}: {elapsed:.0f} s{usually}{written}"


def _compared(elapsed_s: float, usual_s: float) -> str:
    """Return the usual time of a step in words, and whether the step takes much longer now."""
    usual = duration_text(usual_s)
    slow = elapsed_s > LONG * usual_s
    return f", longer than the usual {usual}" if slow else f", usually {usual}"


def behind_line(state: SessionState, how: str) -> str:
    """Return the missions that wait for the operator's decision or answer; '' for none.

    `how` is the way to let the next one go first.
    """
    current = state.current
    if current is None or current.approval is None or not state.queue:
        return ""
    entry, *others = state.queue
    more = f" and {count(len(others), 'other')}" if others else ""
    waits = "wait" if others else "waits"
    return f"{entry.mission.id}{more} {waits} behind {current.mission.id}: {how}"


def _rehearsed(state: SessionState, rate: float) -> str:
    trace = state.missions[state.active or ""]
    attempt = trace.find(trace.executing)
    if attempt is None or attempt.rehearsal is None:
        return ""
    return f" of about {attempt.rehearsal.timeline.duration_s / rate:.0f} s"


def load_usual(path: Path, model: str) -> dict[str, float]:
    """Return the usual seconds by step for `model` (a SHA-256) that are saved at `path`.

    The result is empty if the file cannot be read.
    """
    with suppress(OSError, ValueError, TypeError, AttributeError, KeyError):
        kept = json.loads(path.read_text(encoding="utf-8"))[model]
        return {step: float(taken) for step, taken in kept.items() if step in WORK}
    return {}


def save_usual(path: Path, model: str, usual: Mapping[str, float]) -> None:
    """Save the usual seconds by step for `model`; do nothing if the file cannot be written."""
    kept = {step: taken for step, taken in usual.items() if step in WORK}
    if not kept:
        return
    with suppress(OSError, ValueError):
        make_private_folder(path.parent)
        replace_private(path, json.dumps({model: kept}, sort_keys=True).encode())


def reading_line(trace: MissionTrace, base: str) -> str:
    """Return the reading of a draft, or the reason why it is not clear yet.

    An example is *reads as: Drone_T04 to East Gate; gates stay covered*. Doubts come before
    consequences. The line is empty if the draft has no reading. `base` is the base of the world.
    """
    request = trace.approval
    if trace.status == "refused":
        return f"would be refused: {trace.reason}"
    if request is None:
        return ""
    if request.state == "not_understood":
        question = "; ".join(request.blocked_by).removeprefix(NOT_UNDERSTOOD)
        return f"not clear yet: {question}"
    if trace.standing is not None:
        order = trace.standing.order
        return f"reads as: {trigger_in_words(order)}: {order.order_in_words}"
    return f"reads as: {'; '.join(_parts(trace, request, base))}"


def _parts(trace: MissionTrace, request: ApprovalRequested, base: str) -> Iterator[str]:
    """Yield the moves, then doubts and blocks, then the effects on the gates."""
    attempt = trace.find(request.attempt)
    yield plan_in_words(request.plan, base)
    if request.readings:
        yield f"or: {plain_reading(request.readings[0])}"
    if attempt is None:
        return
    yield from attempt.gaps
    yield from (f"not done: {unmet}" for unmet in attempt.unmet)
    yield from (f"blocked: {reason}" for reason in request.blocked_by)
    if attempt.rehearsal is not None and not request.blocked_by:
        yield from _gates(attempt.rehearsal)


def plan_in_words(plan: Plan, base: str) -> str:
    """Return the commands of a plan, equal ones together: *Drone_T01 and Drone_T02 to Base*.

    For a plan with steps, the first steps are listed in turn.
    """
    if len(plan.steps) > 1:
        shown = [plan_in_words(plan.part(step), base) for step in plan.steps[:MOST_STEPS]]
        left = len(plan.steps) - len(shown)
        return ", then ".join([*shown, *([count(left, "more step")] if left else [])])
    agents: dict[str, list[str]] = {}
    for action in plan.actions:
        spec, place = COMMANDS[action.verb], action.target or ""
        if action.verb == "hold":
            does = "stays"
        elif not spec.moves:
            does = spec.plainly
        else:
            goes = f"to {place_words(place or base)}"
            does = f"{goes}, {spec.plainly}" if spec.plainly else goes
        agents.setdefault(does, []).append(action.agent)
    return (
        ", ".join(f"{listed(names)} {does}" for does, names in agents.items()) or "no asset moves"
    )


def _gates(rehearsal: Rehearsal) -> Iterator[str]:
    """Yield the gates that lose or gain guards, or one line if all stay covered."""
    lines = rehearsal.timeline.gates
    bare = [place_words(gate) for gate, line in lines.items() if not line.covered_after]
    for gate, line in lines.items():
        if line.covered_before and line.covered_after and line.longest_gap_s > 0.0:
            yield f"{place_words(gate)} without a guard for {line.longest_gap_s:.0f} s"
        elif line.covered_after and not line.covered_before:
            yield f"{place_words(gate)} gets a guard"
    if bare:
        yield f"{listed(bare)} without a guard"
    elif all(line.covered_before and not line.longest_gap_s for line in lines.values()):
        yield "gates stay covered"
