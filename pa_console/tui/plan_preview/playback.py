"""Plays a rehearsal: which moment of the plan is shown, at a pace at which one can follow it."""

from dataclasses import dataclass

from pa_console.tui.plan_preview.preview import PlanPreview
from pa_console.tui.protocols import Clock

LONGEST_S = 8.0
"""The longest time that a rehearsal is played, seconds."""

STAYS_S = 1.5
"""The time that its end is shown, seconds."""


@dataclass(frozen=True)
class Playback:
    """The rehearsal of `preview`, played since `began_s` on the `clock`."""

    preview: PlanPreview
    clock: Clock
    began_s: float

    @property
    def _played_s(self) -> float:
        return self.clock() - self.began_s

    @property
    def _plays_s(self) -> float:
        return min(self.preview.duration_s, LONGEST_S)

    @property
    def time_s(self) -> float:
        """The moment of the plan that is shown, in seconds from its start."""
        share = self._played_s / self._plays_s if self._plays_s else 1.0
        return min(share, 1.0) * self.preview.duration_s

    @property
    def is_over(self) -> bool:
        """True if its end has been shown for long enough."""
        return self._played_s >= self._plays_s + STAYS_S
