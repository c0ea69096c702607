"""The canonical words for what an order asks: planner reasons and judge feedback begin with them.

The word order is fixed and the names are the world's own, so that a small model first says what
it has understood. Text that is no order of the operator leaves no trace in it.
"""

from pa_console.llm.compact_prompt import asset_state
from pa_console.llm.facts import WORDS
from pa_console.schema.telemetry import Digest, Picture, Track
from pa_console.schema.world import AssetKind, World
from pa_console.training.conditions import deciding_track, holds, tracks_at
from pa_console.training.order import Ask, Condition, Order, Who

NOWHERE = "unknown place"


def asked(order: Order, world: World, picture: Picture, digest: Digest) -> str:
    """Return what `order` asks, with its condition and how that stands, e.g. "hold; report".

    What the picture says of the condition comes before whether it is so: a small model reads a line
    again far better than it decides from memory.
    """
    words = _all(order.asks, world)
    if order.condition is not None:
        so = "so" if holds(order.condition, picture) else "not so"
        now = f"{_evidence(order.condition, picture, digest)}, {so}"
        otherwise = _all(order.otherwise, world) if order.otherwise else "nothing"
        words = f"if {_fact(order.condition)}: {words}, else: {otherwise}; now: {now}"
    return f"{words}; others stay" if order.others_stay else words


def _all(asks: tuple[Ask, ...], world: World) -> str:
    return "; ".join(_one(ask, world) for ask in asks)


def _one(ask: Ask, world: World) -> str:
    """Return one ask in words; what is wrong with it is said where the names alone do not."""
    place = ask.place if ask.place in world.frames or ask.place in world.zones else NOWHERE
    who, at = _who(ask.who), f" at {place}" if ask.place else ""
    match ask.wrong:
        case "force":
            return f"use force{at}"
        case "chase":
            return "chase beyond the perimeter"
        case "strip":
            return f"leave {place if ask.place else 'all gates'} without guard"
        case "override":
            return f"set rules aside, {_plain(ask, who, place)}"
        case "skip_identification":
            return f"{_plain(ask, who, place)} without identification"
        case "skip_warning":
            return f"{_plain(ask, who, place)} without warning"
        case "noncombatants":
            return f"{_plain(ask, who, place)} with noncombatants"
        case _:
            return _plain(ask, who, place)


def _plain(ask: Ask, who: str, place: str) -> str:  # noqa: PLR0911
    some = f"{who} " if who else ""
    thing = ask.track_id or ask.track
    match ask.task:
        case "go":
            return f"{who or 'somebody'} to {place}"
        case "look":
            return f"{some}look at {place}"
        case "identify" | "warn":
            return f"{some}{ask.task} {thing + ' ' if thing else ''}at {place}"
        case "block":
            return f"{some}block {place}"
        case "respond":
            return f"{ask.track_id or f'unknown {ask.track}'.strip()} at {place}"
        case "cover":
            return f"cover {place if ask.place else ask.leaving}{f' by {who}' if who else ''}"
        case "relieve":
            at = f" at {place}" if ask.place else ""
            return f"{who} relieves {ask.leaving}{at}" if who else f"relieve {ask.leaving}{at}"
        case "swap":
            return f"swap {' and '.join(ask.who.names)}"
        case "home":
            return f"{who} home"
        case "stand_down":
            return f"stand down {place}"
        case "mass":
            free = "all free" if ask.who.kind is None else f"all free {WORDS[ask.who.kind]}s"
            return f"{free} to {place}"
        case "report":
            by = f" by {who}" if who else ""
            return f"report{by}{f' at {place}' if ask.place else ''}"
        case "hold":
            return f"{some}hold"


def _who(who: Who) -> str:
    """Return who is meant, '' when it is left open."""
    if who.names:
        return ", ".join(who.names)
    origin = f" from {who.origin}" if who.origin else ""
    if who.kind is None:
        return f"all{origin}" if who.count == "all" else f"any{origin}" if origin else ""
    word = WORDS[who.kind]
    return f"{who.count} {word}{'' if who.count == 1 else 's'}{origin}"


def _evidence(condition: Condition, picture: Picture, digest: Digest) -> str:
    """Return the line of the compact picture that tells whether `condition` is so."""
    subject = condition.subject
    match condition.fact:
        case "track_at" | "no_track_at":
            here = [f"{track.id} {track.kind}" for track in tracks_at(picture, subject)]
            gone = [f"{t.id} leaves" for t in picture.tracks.values() if t.gate == subject]
            return f"At {subject}: {', '.join(here or gone) or 'no track'}"
        case "authorized" | "unauthorized" | "hostile":
            there = tracks_at(picture, subject, condition.track)
            track = deciding_track(condition, picture) or (there[0] if there else None)
            return f"At {subject}: {_known(track) if track is not None else 'no track'}"
        case "uncovered" | "covered":
            cover = picture.gates.get(subject)
            return f"{subject}: {cover.by[0] if cover is not None and cover.by else 'nobody'}"
        case "low" | "not_low" | "down" | "up":
            asset = picture.assets.get(subject)
            if asset is None:
                return f"{subject}: no such asset"
            return f"{subject}: {asset_state(digest, subject) if asset.available else 'down'}"
        case "free" | "none_free":
            return _first_free(condition.kind, digest)


def _first_free(kind: AssetKind | None, digest: Digest) -> str:
    for each in WORDS if kind is None else (kind,):
        if digest.free[each]:
            return f"Free {WORDS[each]}: {digest.free[each][0]}"
    return f"Free {WORDS[kind]}: none" if kind is not None else "Free: none"


def _known(track: Track) -> str:
    """Return a track with what is known of it, in the compact picture's words."""
    if track.identity == "unknown":
        known = f"not identified{', intent hostile' if track.intent == 'hostile' else ''}"
    else:
        known = f"{track.identity}, intent {track.intent}"
    return f"{track.id} {track.kind}, {known}"


def _fact(condition: Condition) -> str:
    subject, track = condition.subject, condition.track or "track"
    match condition.fact:
        case "track_at":
            return f"{track} at {subject}"
        case "no_track_at":
            return f"no {track} at {subject}"
        case "authorized" | "unauthorized" | "hostile":
            return f"{track} at {subject} {condition.fact}"
        case "not_low":
            return f"{subject} not low"
        case "free" | "none_free":
            word = WORDS[condition.kind] if condition.kind is not None else "asset"
            return f"{'no ' if condition.fact == 'none_free' else ''}{word} free"
        case fact:
            return f"{subject} {fact}"
