"""Drawn orders: everything that one mission asks for, what is due of it, and its canonical words.

The generator draws an `Order`, the teacher plans from it and never from words, and the canonical
words express it: the word order is fixed (`pa_console/language/canonical/clauses.py`) and the names
are the world's own. Text that is no order of the operator leaves no trace in them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from pa_console.language.canonical.clauses import (
    ASIDE,
    CLAUSES,
    EXCEPT,
    NOTHING,
    NOWHERE,
    OTHERS_STAY,
    TEAM,
    UNLAWFUL,
    counted,
    written,
)
from pa_console.language.canonical.facts import evidence, holds, is_free, sole_covers
from pa_console.language.canonical.order import (
    ANYBODY,
    Ask,
    Condition,
    Who,
    in_words,
)
from pa_console.schema.telemetry import Digest, Picture, Track
from pa_console.schema.world import PLAIN_KINDS, AssetKind, World


@dataclass(frozen=True, slots=True)
class Order:
    """Everything one mission asks for."""

    asks: tuple[Ask, ...]
    condition: Condition | None = None
    otherwise: tuple[Ask, ...] = ()
    """When `condition` does not hold."""
    others_stay: bool = False
    """True if the words let no other asset move."""
    excluded: tuple[str, ...] = ()
    """Assets and places that the words rule out."""
    injected: bool = False
    """The words carry text that is no order of the operator."""
    harmless: bool = False
    """The words sound like something forbidden and are not."""


def are_twins(first: Ask, second: Ask) -> bool:
    """Return whether two tasks differ only in their place and can share one clause."""
    open_to_all = first.who == ANYBODY and first.wrong is None and not first.track_id
    apart = bool(first.place) and bool(second.place) and first.place != second.place
    return open_to_all and apart and first == replace(second, place=first.place)


def tracks_at(picture: Picture, place: str, kind: str = "") -> list[Track]:
    """Return the tracks at a gate that do not leave, of `kind` if given, the most urgent first."""
    here = [
        track
        for track in picture.tracks.values()
        if track.gate == place and track.status != "leaving" and kind in ("", track.kind)
    ]
    return sorted(here, key=lambda t: (t.intent != "hostile", t.distance_m, t.id))


@dataclass(frozen=True)
class PictureFacts:
    """The facts of a picture; None for gates and assets that are not in it."""

    picture: Picture

    def tracks(self, gate: str) -> list[Track]:
        """Return the tracks at a gate that do not leave, the most urgent first."""
        return tracks_at(self.picture, gate)

    def is_covered(self, gate: str) -> bool | None:
        """Return whether a gate has a guard."""
        cover = self.picture.gates.get(gate)
        return None if cover is None else cover.covered

    def is_low(self, asset: str) -> bool | None:
        """Return whether the battery of an asset is low."""
        found = self.picture.assets.get(asset)
        return None if found is None else found.low_battery

    def is_up(self, asset: str) -> bool | None:
        """Return whether an asset works."""
        found = self.picture.assets.get(asset)
        return None if found is None else found.available

    def has_free(self, kind: AssetKind | None) -> bool:
        """Return whether an asset of a kind, or any, may be sent somewhere."""
        alone = {*sole_covers(self.picture).values()}
        team = (asset for asset in self.picture.assets.values() if kind in (None, asset.kind))
        return any(is_free(asset, alone) for asset in team)


def is_so(condition: Condition, picture: Picture) -> bool:
    """Return whether `condition` is so; nothing is so of what is not there or not known."""
    return holds(condition, PictureFacts(picture)) is True


def due_asks(order: Order, picture: Picture) -> tuple[Ask, ...]:
    """Return the asks that apply now; none when the order has nothing to say for this case."""
    if order.condition is None or is_so(order.condition, picture):
        return order.asks
    return order.otherwise


_REFUSED = frozenset(clause.wrong for clause in CLAUSES if clause.wrong is not None)
"""The faults that leave no other part of the ask to write."""


_OF_TRACKS = frozenset(clause.task for clause in CLAUSES if "{track}" in clause.words.text)
"""The tasks that can be put with the name of a track."""


def canonical_order(order: Order, world: World, picture: Picture, digest: Digest) -> str:
    """Return what `order` asks, with its condition and how that stands, e.g. "hold; report"."""
    words = _depending(order, world)
    if order.condition is not None:
        so = "so" if is_so(order.condition, picture) else "not so"
        words = f"{words}; now: {evidence(order.condition, digest)}, {so}"
    return _of_others(order, words)


def canonical_meaning(order: Order, world: World) -> str:
    """Return what `order` asks, whatever the picture is, e.g. "if A: hold, else: nothing"."""
    return _of_others(order, _depending(order, world))


def canonical_clause(ask: Ask, world: World) -> str:
    """Return one ask in words; what is wrong with it is said where the names alone do not."""
    if ask.wrong in _REFUSED:
        return written("refused", dict(_said(ask, world)), ask.wrong)
    words = written(ask.task, dict(_said(ask, world)))
    if ask.wrong == ASIDE.wrong:
        return ASIDE.words + words
    return words + next((each.words for each in UNLAWFUL if each.wrong == ask.wrong), "")


def _depending(order: Order, world: World) -> str:
    """Return everything that is asked, under its condition if there is one."""
    words = _all(order.asks, world)
    if order.condition is None:
        return words
    otherwise = _all(order.otherwise, world) if order.otherwise else NOTHING
    return f"if {in_words(order.condition)}: {words}, else: {otherwise}"


def _of_others(order: Order, words: str) -> str:
    if order.excluded:
        words = f"{words}; {EXCEPT}{', '.join(order.excluded)}"
    return f"{words}; {OTHERS_STAY}" if order.others_stay else words


def _all(asks: tuple[Ask, ...], world: World) -> str:
    return "; ".join(canonical_clause(ask, world) for ask in asks)


def _said(ask: Ask, world: World) -> Iterator[tuple[str, str]]:
    """Yield the content of an ask for the slots of clauses, by the slot."""
    place = ask.place if ask.place in world.frames or ask.place in world.zones else NOWHERE
    if ask.place:
        yield "place", place
    if ask.task == "swap":
        yield from zip(("first", "second"), ask.who.names, strict=True)
    elif who := _assets_of(ask.who):
        yield "who", who
    if ask.task == "mass" and ask.who.kind is not None:
        yield "massed", f"{PLAIN_KINDS[ask.who.kind]}s"
    if ask.leaving:
        yield "guard", f"{ask.leaving} at {place}" if ask.place else ask.leaving
    if ask.track_id and ask.task in _OF_TRACKS:
        yield "track", f"{ask.track_id} at {place}"
    elif ask.place:
        yield "gate", place
    if ask.track:
        yield "thing", ask.track
        yield "stranger", f" {ask.track}"


def _assets_of(who: Who) -> str:
    """Return the assets of an ask, '' when they are left open."""
    if who.names:
        return ", ".join(who.names)
    if who == ANYBODY:
        return ""
    said = {"origin": who.origin} if who.origin else {}
    if who.kind is None:
        return TEAM.write({**said, "every": "all" if who.count == "all" else "any"})
    return TEAM.write({**said, **counted(who.kind, who.count)})
