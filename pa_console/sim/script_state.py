"""How far a scenario has come in one simulation; part of what a fork copies and a hash covers."""

from dataclasses import dataclass, field


@dataclass(slots=True)
class ScriptState:
    """Progress of a scenario whose random events are drawn from `seed`.

    `due_s` says when a scripted event happens, known once its condition has held; `happened` and
    `skipped` hold the events that are over. `drawn` counts the random events of each process,
    the next of which is due at `next_s`. Events and processes are named by their index.
    """

    seed: int = 0
    due_s: dict[int, float] = field(default_factory=dict[int, float])
    happened: tuple[int, ...] = ()
    skipped: tuple[int, ...] = ()
    drawn: tuple[int, ...] = ()
    next_s: tuple[float, ...] = ()

    def copy(self) -> "ScriptState":
        """Return an independent copy."""
        return ScriptState(
            seed=self.seed,
            due_s=dict(self.due_s),
            happened=self.happened,
            skipped=self.skipped,
            drawn=self.drawn,
            next_s=self.next_s,
        )
