"""What serves a wish about whoever is at a gate: the step that is due there (WF-01).

Recon from the air, then identification, then a warning, then a block of what is hostile and was
warned; noncombatants are only watched (ROE-08). The workflow goes on by itself later.
"""

from collections.abc import Iterator

from pa_console.llm.reading import Wish
from pa_console.llm.slot_grammar import Slot
from pa_console.orchestrator.lacking import is_to_be_warned
from pa_console.orchestrator.serving_stands import Stands, Unit, UntoldError
from pa_console.schema.telemetry import Track


def identified(stands: Stands, wish: Wish) -> Iterator[Unit]:
    """Yield who finds out who is there; a drone looks first where nobody has (WF-02)."""
    yield _only_looked_at(stands, wish.place) or _identified(stands, wish)


def met(stands: Stands, wish: Wish) -> Iterator[Unit]:
    """Yield what is due about whoever is there, or that a drone looks where nobody is known."""
    tracks = stands.tracks(wish.place)
    if look := _only_looked_at(stands, wish.place):
        yield look
    elif any(_is_stranger(track) for track in tracks):
        at_once = wish.task == "warn" or all(track.observed for track in tracks)
        yield _identified(stands, wish) if at_once else Unit(_look(stands, wish.place))
    elif any(map(is_to_be_warned, tracks)):
        yield Unit((Slot(_robots(stands, wish), f"warn {wish.place}"),))
    else:
        raise UntoldError


def blocked(stands: Stands, wish: Wish) -> Iterator[Unit]:
    """Yield who closes a lane; whoever is there is met in order before (WF-01)."""
    if all(map(_may_block, stands.tracks(wish.place))):
        if wish.team.names:
            yield from (Unit((Slot((n,), f"block {wish.place}"),)) for n in stands.fit(wish))
        elif vehicles := stands.near(wish.place, "ugv"):
            yield Unit((Slot(vehicles, f"block {wish.place}"),))
    else:
        yield from met(stands, wish._replace(task="respond", team=wish.team._replace(names=())))


def _is_stranger(track: Track) -> bool:
    return track.identity == "unknown" and track.status != "leaving"


def _may_block(track: Track) -> bool:
    known = track.identity == "unauthorized" and track.warned and track.intent == "hostile"
    return known and not track.noncombatants


def _identified(stands: Stands, wish: Wish) -> Unit:
    look = () if all(t.observed for t in stands.tracks(wish.place)) else _look(stands, wish.place)
    return Unit((*look, Slot(_robots(stands, wish), f"identify {wish.place}")))


def _only_looked_at(stands: Stands, place: str) -> Unit | None:
    """Return the look that is all that is due where nobody is known to be, or noncombatants are."""
    tracks = stands.tracks(place)
    if tracks and not any(track.noncombatants for track in tracks):
        return None
    return Unit(_look(stands, place), ahead=not tracks)


def _look(stands: Stands, place: str) -> tuple[Slot, ...]:
    """Return that a drone looks at a place."""
    return (Slot(stands.near(place, "uav"), f"observe {place}"),)


def _robots(stands: Stands, wish: Wish) -> tuple[str, ...]:
    """Return who can be sent to deal with somebody: those whom `wish` names, or any robot."""
    return tuple(stands.fit(wish)) or stands.near(wish.place, "robot")
