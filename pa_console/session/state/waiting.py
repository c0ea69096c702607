"""What is being waited for: a step of the active mission, since when, how long it usually takes.

Times are seconds of one clock that the caller names; a replay has none.
"""

import json
from collections import defaultdict, deque
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from statistics import median

from pa_console.private_files import make_private_folder, replace_private
from pa_console.schema.events import event as ev
from pa_console.schema.text.quantities import duration_text
from pa_console.session.state.fold import SessionState

WORK = {
    "retrieve": "finding the rules that apply",
    "picture": "reading the picture",
    "prompt": "preparing the question to the model",
    "plan": "the model writes the plan",
    "safeguards": "the plan is checked and rehearsed",
    "judge": "the judge reads the plan",
    "execute": "the assets carry out the plan",
    "verify": "telemetry is compared with the plan",
    "report": "the report is written",
}
"""What happens in each step that takes its time without the operator."""

TOLD_AFTER_S = 0.3
"""A step that has just begun may be over before anybody has read its name."""

_REMEMBERED = 20
_LEAST = 3
"""From so many durations on, a session's own median is the usual time."""
_CHARACTERS = 3.5
"""Characters of a token, as long as no answer has told its tokens."""


class Waiting:
    """Follows the steps of the active mission; `usual` are seconds by step of earlier sessions."""

    def __init__(self, usual: Mapping[str, float] | None = None) -> None:
        self._stored = dict(usual or {})
        self._taken: defaultdict[str, deque[float]] = defaultdict(lambda: deque(maxlen=_REMEMBERED))
        self._step: tuple[str, str] | None = None
        self._since = 0.0
        self._written = 0
        self._characters, self._tokens = 0, 0

    def take(self, event: ev.Event, state: SessionState, now: float) -> None:
        """Take in an event that is in `state` already, at `now`."""
        match event.data:
            case ev.TextStreamed(text=text):
                self._written += len(text)
            case ev.PlanProposed(text=text, usage=usage) if usage.completion_tokens:
                self._characters += len(text)
                self._tokens += usage.completion_tokens
            case _:
                pass
        step = self._active_step(state)
        if step == self._step:
            return
        if self._step is not None and step is not None and self._step[0] == step[0]:
            self._taken[self._step[1]].append(now - self._since)
        self._step, self._since, self._written = step, now, 0

    def _active_step(self, state: SessionState) -> tuple[str, str] | None:
        trace = state.missions.get(state.active or "")
        return (trace.mission.id, trace.stage) if trace is not None else None

    def usual_s(self, step: str) -> float | None:
        """Return how long `step` usually takes; None when nothing is known of it."""
        taken = self._taken.get(step, ())
        if len(taken) >= _LEAST or (taken and step not in self._stored):
            return median(taken)
        return self._stored.get(step)

    @property
    def usual(self) -> dict[str, float]:
        """The usual seconds of every step that is known, to be kept for the next session."""
        known = {*self._stored, *self._taken}
        return {
            step: round(taken, 3)
            for step in sorted(known)
            if (taken := self.usual_s(step)) is not None
        }

    @property
    def tokens(self) -> int:
        """About how many tokens of the present answer have come."""
        each = self._characters / self._tokens if self._tokens else _CHARACTERS
        return round(self._written / each)

    def line(self, now: float, state: SessionState) -> str:
        """Say what is being done, for how long, and how long that usually takes; '' for nothing."""
        if state.worker is not None and state.worker.state == "loading" and state.active:
            return "the model is being loaded"
        if self._step is None or self._step[1] not in WORK:
            return ""
        elapsed = now - self._since
        if elapsed < TOLD_AFTER_S:
            return ""
        step = self._step[1]
        usual = self.usual_s(step)
        usually = f", usually {duration_text(usual)}" if usual is not None else ""
        written = f", {self.tokens} tokens" if self._written else ""
        return f"{WORK[step]}: {elapsed:.0f} s{usually}{written}"


def load_usual(path: Path, model: str) -> dict[str, float]:
    """Return the usual seconds by step with `model` (its SHA-256) that are kept at `path`.

    A file that cannot be read knows nothing.
    """
    with suppress(OSError, ValueError, TypeError, AttributeError, KeyError):
        kept = json.loads(path.read_text(encoding="utf-8"))[model]
        return {step: float(taken) for step, taken in kept.items() if step in WORK}
    return {}


def save_usual(path: Path, model: str, usual: Mapping[str, float]) -> None:
    """Keep the usual seconds by step with `model`; what cannot be written is not kept."""
    kept = {step: taken for step, taken in usual.items() if step in WORK}
    if not kept:
        return
    with suppress(OSError, ValueError):
        make_private_folder(path.parent)
        replace_private(path, json.dumps({model: kept}, sort_keys=True).encode())
