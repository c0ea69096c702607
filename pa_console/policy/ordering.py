"""How an ordering of events goes on for one subject, moment by moment (schema/rule.py Ordering)."""

from typing import Literal, NamedTuple

from pa_console.schema.rule import Ordering

Stage = Literal["idle", "open", "settled", "broken"]

CLOCK_S = 1e-6
"""Times closer than this are the same."""


class Progress(NamedTuple):
    """Where a subject stands.

    idle     nothing has happened yet
    open     something must happen still; for `within` since `since_s`, simulated seconds
    settled  what had to happen has happened, or cannot be missed any more
    broken   it is wrong at present, and that has been told
    """

    stage: Stage = "idle"
    since_s: float = 0.0

    def overdue(self, time_s: float, limit_s: float) -> bool:
        """Return whether a time limit that runs is over at `time_s`."""
        return self.stage == "open" and time_s > self.since_s + limit_s + CLOCK_S


START = Progress()
_SETTLED, _BROKEN = Progress("settled"), Progress("broken")


def follow(
    order: Ordering,
    was: Progress,
    *,
    event: bool,
    other: bool,
    time_s: float,
    limit_s: float,
) -> tuple[Progress, bool]:
    """Return where the subject stands after this moment, and whether it broke the ordering now.

    What held at the last moment is taken to have held until this one. `limit_s` is of `within`.
    """
    match order.kind:
        case "before":
            if was.stage == "settled" or other:
                return _SETTLED, False
            return (_SETTLED, True) if event else (START, False)
        case "after":
            if was.stage == "settled" or not (other or was.stage == "open"):
                return was, False
            began = was if was.stage == "open" else Progress("open", time_s)
            return (_SETTLED if event else began), False
        case "never_while":
            return _wrong_while(event and other, was)
        case "until":
            if was.stage == "settled" or other:
                return _SETTLED, False
            return _wrong_while(not event, was)
        case "within":
            return _in_time(was, event, other, time_s, limit_s)


def leave(order: Ordering, was: Progress, time_s: float, limit_s: float) -> tuple[Progress, bool]:
    """Return the same for a subject that is no longer there: what went on with it has ended."""
    if order.kind in ("never_while", "within"):
        return follow(order, was, event=False, other=False, time_s=time_s, limit_s=limit_s)
    return was, False


def _wrong_while(wrong: bool, was: Progress) -> tuple[Progress, bool]:
    """Tell once what is wrong, and again only after it has been right in between."""
    return (_BROKEN, was.stage != "broken") if wrong else (START, False)


def _in_time(
    was: Progress, event: bool, other: bool, time_s: float, limit_s: float
) -> tuple[Progress, bool]:
    """Follow one obligation from where `other` begins to where it is met, or `other` ends."""
    late = was.overdue(time_s, limit_s)
    if not other:
        return START, late
    if event or was.stage == "settled":
        return _SETTLED, late
    if late or was.stage == "broken":
        return _BROKEN, late
    return (was if was.stage == "open" else Progress("open", time_s)), late
