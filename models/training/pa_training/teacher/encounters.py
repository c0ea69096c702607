"""Drafts for asks about whoever is at a gate: the step that is due, in the workflow's order.

Recon from the air, then identification, then a warning, then a block of what is confirmed as
hostile (WF-01); noncombatants are only watched (ROE-08). The workflow goes on by itself later.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from pa_console.language.canonical.order import Ask, Who
from pa_console.schema.telemetry import Track
from pa_console.schema.world import AssetKind
from pa_training.teacher.moves import look
from pa_training.teacher.roster import (
    MOST_OPTIONS,
    Command,
    Draft,
    Roster,
    TakenAssets,
    asset_objection,
    none_free,
    refusal,
    teams,
)

Step = Literal["observe", "identify", "warn", "block", ""]
_WORKER: dict[Step, AssetKind] = {"identify": "robot", "warn": "robot", "block": "ugv"}
_DOES: dict[Step, str] = {"identify": "identifies", "warn": "warns", "block": "blocks"}


def respond(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Do what is due about the track at the place; where none is known, have a look."""
    track = roster.track(ask.place, ask.track, ask.track_id)
    return _do(ask, due(track), track, desk, roster)


def identify(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Let a robot find out who is there, with a drone's look before it where none has been."""
    track = roster.track(ask.place, ask.track, ask.track_id)
    if track is None:
        return _do(ask, "observe", track, desk, roster)
    if track.noncombatants and not ask.track_id:
        return _watch(ask, track, desk, roster)
    return _do(ask, "identify", track, desk, roster)


def warn(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Let a robot warn whom it knows; one that is not identified is identified first."""
    track = roster.track(ask.place, ask.track, ask.track_id)
    if track is None:
        return _do(ask, "observe", track, desk, roster)
    if track.noncombatants:
        return _watch(ask, track, desk, roster)
    if track.identity == "authorized":
        return _idle(ask, f"{track.id} is authorized")
    return _do(ask, "identify" if track.identity == "unknown" else "warn", track, desk, roster)


def block(ask: Ask, desk: TakenAssets, roster: Roster) -> list[Draft]:
    """Let a vehicle close the lane if nobody is there, or a warned threat; else do what is due."""
    tracks = [t for t in roster.picture.tracks.values() if t.gate == ask.place]
    open_ones = sorted((t for t in tracks if not _may_block(t)), key=lambda t: t.distance_m)
    if not open_ones:
        return _do(ask, "block", tracks[0] if tracks else None, desk, roster)
    track = open_ones[0]
    if track.noncombatants:
        return _watch(ask, track, desk, roster)
    step = due(track)
    if step in ("", "block"):
        return [refusal(ask, f"{track.id} is no confirmed threat", "WF-01")]
    return _do(ask, step, track, desk, roster)


def due(track: Track | None) -> Step:
    """Return the next step of the workflow for `track`, '' when nothing is due."""
    if track is None or track.noncombatants or not track.observed:
        return "observe"
    if track.status == "leaving" or track.identity == "authorized":
        return ""
    if track.identity == "unknown":
        return "identify"
    if not track.warned:
        return "warn"
    if track.intent == "hostile":
        return "block"
    return "observe" if track.defiant else ""


def _may_block(track: Track) -> bool:
    known = track.identity == "unauthorized" and track.warned and track.intent == "hostile"
    return known and not track.noncombatants


def _do(
    ask: Ask, step: Step, track: Track | None, desk: TakenAssets, roster: Roster
) -> list[Draft]:
    """Return the drafts for one step about `track` at the ask's place."""
    if track is not None and track.gate != ask.place:
        ask = replace(ask, place=track.gate)
    if not step:
        assert track is not None
        state = track.status if track.status == "leaving" else _known(track)
        return _idle(ask, f"{track.id} is {state}")
    if step == "observe":
        return _watch(ask, track, desk, roster)
    if step == "warn" and roster.strangers(ask.place):
        step, track = "identify", roster.strangers(ask.place)[0]
    workers = _workers(ask, step, desk, roster)
    if not workers:
        kind = replace(ask, who=Who(kind=_WORKER[step]))
        if ask.task == "respond" and step in ("identify", "block"):
            return _watch(ask, track, desk, roster, note=none_free(kind))
        return [refusal(ask, none_free(kind), "CAP-10")]
    note = _state(ask.place, track)
    if step == "identify" and roster.unseen(ask.place):
        return _with_recon(ask, workers, note, desk, roster)
    return [
        Draft(ask, ((name, f"{step} {ask.place}"),), (f"{note}, {name} {_DOES[step]}",))
        for name in workers[:MOST_OPTIONS]
    ]


def _with_recon(
    ask: Ask, workers: Sequence[str], note: str, desk: TakenAssets, roster: Roster
) -> list[Draft]:
    """Return identification with a drone's look ahead of it (WF-01, WF-02)."""
    found: list[Draft] = []
    for drone in _observers(ask, desk, roster):
        for robot in workers[:2]:
            commands: tuple[Command, ...] = (
                (drone, f"observe {ask.place}"), (robot, f"identify {ask.place}"),
            )  # fmt: skip
            why = f"{note}, {drone} looks first (WF-01)"
            found.append(Draft(ask, commands, (why,)))
    return found or [refusal(ask, "Free drone: none to look first", "WF-02")]


def _watch(
    ask: Ask, track: Track | None, desk: TakenAssets, roster: Roster, note: str = ""
) -> list[Draft]:
    """Return drafts in which a drone observes the place: one that stands there, else a spare."""
    place = track.gate if track is not None else ask.place
    changed = replace(ask, place=place)
    barred = track is not None and track.noncombatants
    said = "noncombatants (ROE-08)" if barred else note or _state(place, track)
    aim = replace(changed, who=Who())
    if ask.task != "respond" and (barred or track is None):
        aim = Ask(task="look", place=place)
    return [
        Draft(
            aim,
            ((drone, f"observe {place}"),),
            (f"{said}, {drone} observes",),
            undone=barred and ask.task != "respond",
        )
        for drone in _observers(changed, desk, roster)
    ] or [refusal(changed, "Free drone: none", "WF-02")]


def _observers(ask: Ask, desk: TakenAssets, roster: Roster) -> list[str]:
    """Return the drones that can have a look at the place, best first."""
    anyone = Ask(task="look", place=ask.place)
    asked_for = [n for n in ask.who.names if n in roster.world.assets and roster.up(n)]
    drones = [n for n in asked_for if roster.kind(n) == "uav" and roster.clear(n)]
    found = [draft.agents[0] for draft in look(anyone, desk, roster) if draft.agents]
    return [*drones, *(name for name in found if name not in drones)]


def _workers(ask: Ask, step: Step, desk: TakenAssets, roster: Roster) -> list[str]:
    """Return who can do the step: those named, those at the place, then the free ones."""
    kind = _WORKER[step]
    own = [n for n in ask.who.names if asset_objection(n, ask, roster) is None]
    able = [n for n in own if roster.kind(n) == kind and n not in desk.used]
    if able:
        return able[:1]
    taken = desk.taken(ask.who.names)
    here = [n for n in roster.there(ask.place, (kind,)) if n not in taken and roster.clear(n)]
    sent = replace(ask, who=Who(kind=kind, origin=ask.who.origin))
    spare = [team[0] for team, _ in teams(sent, desk, roster, (kind,)) if roster.clear(team[0])]
    healthy = [n for n in (*here, *spare) if not roster.low(n)]
    return list(dict.fromkeys(healthy))


def _idle(ask: Ask, why: str) -> list[Draft]:
    return [Draft(ask, why=(f"{why}, nothing is due",))]


def _known(track: Track) -> str:
    if track.identity == "authorized":
        return "authorized"
    return "warned and no confirmed threat"


def _state(place: str, track: Track | None) -> str:
    """Return in words what decides the step, begun as the compact picture begins its line."""
    if track is None:
        return f"At {place}: no track"
    return f"At {track.gate}: {track.id} {track.kind}, {_known_of(track)}"


def _known_of(track: Track) -> str:
    if not track.observed:
        return "not observed"
    if track.identity == "unknown":
        return "not identified"
    if not track.warned:
        return f"{track.identity}, not warned"
    return f"{track.intent}, warned"
