"""The things to which words can refer, in the present picture and in earlier orders.

The scene provides every fact that a description needs: guards, free assets, distances.
"""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

from pa_console.language.canonical.facts import is_free, sole_covers
from pa_console.language.mentions import KINDS
from pa_console.language.name_linking import WORD, WorldNames
from pa_console.schema.command import STILL, Verb
from pa_console.schema.telemetry import AssetTelemetry, Picture, Track
from pa_console.schema.world import AssetKind, World

MOST_COMMANDS = 6
"""The largest number of commands of an earlier order that a prompt quotes."""

_NOBODY: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Move:
    """A command to one asset; `before` is the frame where the asset was, or ''."""

    agent: str
    verb: Verb
    target: str = ""
    before: str = ""


@dataclass(frozen=True)
class PastMission:
    """A past mission: its text with resolved references, and its commands."""

    text: str
    moves: tuple[Move, ...]
    undid: bool = False
    """True if the mission took back the order before it."""

    @property
    def commands(self) -> str:
        """The commands in one line: *Drone_T04 move_to EastGate from Base; Robot_T01 report*."""
        return "; ".join(
            f"{move.agent} {move.verb} {move.target}".rstrip()
            + (f" from {move.before}" if move.before not in ("", move.target) else "")
            for move in self.moves[:MOST_COMMANDS]
        )


@dataclass(frozen=True)
class ReferenceScene:
    """A world, its present picture, and the past missions, the latest last.

    `pointer` is the asset, gate or track that the operator has marked on the screen; '' for none.
    """

    world: World
    picture: Picture
    past: Sequence[PastMission] = ()
    pointer: str = ""

    @cached_property
    def names(self) -> WorldNames:
        """The names of the world, by the words that operators use for them."""
        return WorldNames.of(self.world)

    @cached_property
    def sole(self) -> frozenset[str]:
        """The assets that are the only cover of a gate."""
        return frozenset(sole_covers(self.picture).values())

    @cached_property
    def frames_by_word(self) -> Mapping[str, str]:
        """The frames by their names in lower case."""
        return {name.lower(): name for name in self.world.frames}

    @cached_property
    def assets_by_word(self) -> Mapping[str, str]:
        """The assets by their names in lower case."""
        return {name.lower(): name for name in self.world.assets}

    def members(self, word: str) -> frozenset[str]:
        """Return the assets of the kind or team `word`, singular or plural; else an empty set."""
        single = f"{word[:-3]}y" if word.endswith("ies") else word.removesuffix("s")
        assets = tuple((name, spec.kind) for name, spec in self.world.assets.items())
        teams, kinds = _teams(assets)
        kind = KINDS.get(single) or ("ugv" if single == "vehicle" else None)
        return teams.get(single) or (kinds.get(kind, _NOBODY) if kind is not None else _NOBODY)

    @property
    def gates(self) -> Sequence[str]:
        """The gates of the world."""
        return self.world.gates

    def asset(self, name: str) -> AssetTelemetry:
        """Return the telemetry of an asset; raises KeyError for an unknown one."""
        return self.picture.assets[name]

    def place_of(self, name: str) -> str:
        """Return the post of an asset, or else the frame where it is; '' for neither."""
        asset = self.picture.assets.get(name)
        return "" if asset is None else asset.post or asset.at or ""

    def at(self, place: str) -> list[str]:
        """Return the available assets that are posted at a frame or are there."""
        return [n for n, a in self.picture.assets.items() if a.available and self._is_at(a, place)]

    def stationed(self, place: str) -> list[str]:
        """Return the assets that are posted at a frame or are there, available or not."""
        return [n for n, a in self.picture.assets.items() if self._is_at(a, place)]

    def guards(self, gate: str) -> tuple[str, ...]:
        """Return the assets that cover a gate."""
        cover = self.picture.gates.get(gate)
        return () if cover is None else cover.by

    def guarded_by(self, name: str) -> str:
        """Return the gate at which an asset has its post; '' for none."""
        place = self.place_of(name)
        return place if place in self.world.gates else ""

    def is_free(self, name: str) -> bool:
        """Return whether an asset may leave without uncovering a gate or giving up its task."""
        return is_free(self.asset(name), self.sole)

    def spot(self, name: str) -> tuple[float, float]:
        """Return the position of a frame or asset, in metres; raises KeyError for another name."""
        frame = self.world.frames.get(name)
        return frame.at if frame is not None else self.asset(name).position

    def distance_m(self, start: str, end: str) -> float:
        """Return the distance between two frames or assets, in metres."""
        return math.dist(self.spot(start), self.spot(end))

    def visitors(self, kind: str = "") -> list[Track]:
        """Return the tracks that are not leaving, of `kind` if given."""
        tracks = self.picture.tracks.values()
        return [t for t in tracks if t.status != "leaving" and kind in ("", t.kind)]

    @property
    def moved(self) -> list[Move]:
        """All commands so far that moved an asset, the latest last, without withdrawals."""
        done = (mission.moves for mission in self.past if not mission.undid)
        return [move for moves in done for move in moves if move.verb not in STILL]

    @property
    def last(self) -> PastMission | None:
        """The last mission that moved an asset and was not a withdrawal."""
        moving = (p for p in self.past if any(m.verb not in STILL for m in p.moves))
        return next((p for p in reversed([*moving]) if not p.undid), None)

    @property
    def asked_about(self) -> str:
        """The asset that the latest mission asked for a report, as its only order; '' for none."""
        moves = self.past[-1].moves if self.past else ()
        return moves[0].agent if len(moves) == 1 and moves[0].verb == "report" else ""

    def in_order(self, names: Iterable[str]) -> tuple[str, ...]:
        """Return `names`, each once, in the order of the world."""
        chosen = set(names)
        return tuple(n for n in (*self.world.frames, *self.world.assets) if n in chosen)

    @staticmethod
    def _is_at(asset: AssetTelemetry, place: str) -> bool:
        return place in (asset.post or asset.at, asset.at if asset.post is None else asset.post)


@lru_cache(maxsize=8)
def _teams(
    assets: tuple[tuple[str, AssetKind], ...],
) -> tuple[Mapping[str, frozenset[str]], Mapping[AssetKind, frozenset[str]]]:
    """Return the assets by the words in their names, and by their kinds."""
    teams: defaultdict[str, set[str]] = defaultdict(set)
    kinds: defaultdict[AssetKind, set[str]] = defaultdict(set)
    for name, kind in assets:
        kinds[kind].add(name)
        for word in (part.lower() for part in WORD.findall(name)):
            if len(word) > 1 and word.isalpha():
                teams[word].add(name)
    return (
        {word: frozenset(names) for word, names in teams.items()},
        {kind: frozenset(names) for kind, names in kinds.items()},
    )


def after(past: Sequence[PastMission], mission: PastMission, *, corrects: bool) -> PastMission:
    """Return `mission` as it is remembered after the `past` missions.

    A mission that `corrects` the last one replaces it. An asset that both missions moved keeps its
    place from before the first. An asset that is only sent back does not count as moved.
    """
    last = next((earlier for earlier in reversed(past) if not earlier.undid), None)
    if not corrects or last is None:
        return mission
    before = {move.agent: move.before for move in last.moves if move.verb not in STILL}
    kept = [
        replace(move, before=before.get(move.agent, move.before))
        for move in mission.moves
        if move.verb in STILL
        or move.agent not in before
        or before[move.agent] not in (move.target, "" if move.target else before[move.agent])
    ]
    return replace(mission, moves=tuple(kept))
