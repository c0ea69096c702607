"""A parser for patrols: *patrol west and north twice*, *have a robot walk the gates*.

No model reads patrols. Every word must belong to the description of the patrol. The operator is
asked about any other words, and about a patrol without an end.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

from pa_console.language.clock_words import duration_words, read_duration, read_number
from pa_console.language.lexicon import word_lists
from pa_console.language.mentions import ASSETS, KINDS
from pa_console.language.name_linking import link_names
from pa_console.language.references.conversation import Unclear
from pa_console.language.references.reader import Reader, asset_at, place_at, read_tokens
from pa_console.language.references.scene import ReferenceScene
from pa_console.schema.world import AssetKind

_WORDS = word_lists("patrols")
_FILLERS = frozenset(_WORDS["fillers"])
_ROUND, _ROUNDS = frozenset(_WORDS["round"]), frozenset(_WORDS["rounds"])
_DWELL = frozenset(_WORDS["dwell"])
_TIMES = {"once": 1, "twice": 2, "thrice": 3}


@dataclass(frozen=True)
class PatrolLimits:
    """The limits of patrols: the default stay at each place, in seconds, and the most laps."""

    stay_s: float = 10.0
    most_laps: int = 10


USUAL = PatrolLimits()
"""The default limits."""


@dataclass(frozen=True)
class Patrol:
    """A patrol: its places in order, the number of laps, the stay at each place, and the asset."""

    places: tuple[str, ...]
    laps: int
    stay_s: float
    asset: str = ""
    """The name of the asset; '' for any asset of the `kind`."""
    kind: AssetKind | None = None
    any_order: bool = False
    """True if the asset goes to the nearest place first."""

    @property
    def words(self) -> str:
        """The patrol in words."""
        subject = self.asset or (f"a {self.kind}" if self.kind else "an asset")
        order = ", nearest first" if self.any_order else ""
        laps = f"{self.laps} laps" if self.laps > 1 else "one lap"
        stay = f", {duration_words(self.stay_s)} at each" if self.stay_s else ""
        return f"{subject} patrols {', '.join(self.places)}{order}: {laps}{stay}"


def read_patrol(scene: ReferenceScene, text: str, limits: PatrolLimits) -> Patrol | Unclear | None:
    """Return the patrol in `text`, a question about it, or None if it is no patrol."""
    reading = _Reading(scene, text)
    reading.read()
    if not reading.goes or len({*reading.places}) < 2:
        return None
    patrol = reading.patrol(limits)
    return None if isinstance(patrol, Unclear) and not reading.certain else patrol


class _Reading:
    """A parser for one text, from its first word to its last."""

    def __init__(self, scene: ReferenceScene, text: str) -> None:
        self._scene = scene
        self._reader = Reader(read_tokens(link_names(scene.world, text)))
        self.goes = self.certain = False
        """`certain` is True if the words can only be a patrol."""
        self.places: list[str] = []
        self._names: list[str] = []
        self._kinds: list[AssetKind] = []
        self._laps, self._stay_s = 0, -1.0
        self._first, self._turn, self._any_order = "", 0, False
        self._endless, self._left = "", list[str]()

    def read(self) -> None:
        """Read the whole text."""
        reader = self._reader
        ways = (
            self._takes_laps, self._takes_dwell, self._takes_way, self._takes_going,
            self._takes_places, self._takes_asset,
        )  # fmt: skip
        while not reader.over:
            start = reader.at
            for way in ways:
                if way():
                    break
                reader.at = start
            else:
                if reader.word() not in _FILLERS:
                    self._left.append(reader.written())
                reader.at += 1

    def _takes_laps(self) -> bool:
        """Read *twice*, *three times*, *two rounds of*, *one round of*, *until told otherwise*."""
        reader = self._reader
        if way := reader.take(*_WORDS["endless"]):
            self._endless = way
            return True
        if (count := _TIMES.get(reader.word(), 0)) or reader.take("a full", "a single"):
            reader.at += bool(count)
            self._laps = count or 1
            if reader.take_in(_ROUND):
                self.goes = self.certain = True
            return True
        start = reader.at
        number = 1.0 if reader.take("a", "another") else read_number(reader)
        counted = reader.take_in(_ROUNDS) or (number == 1.0 and reader.take_in(_ROUND | {"time"}))
        if number < 1.0 or not counted:
            reader.at = start
            return False
        self._laps = int(number)
        if counted not in ("times", "time"):
            self.goes = self.certain = True
            reader.take(*_WORDS["of"])
        return True

    def _takes_dwell(self) -> bool:
        """Read *with a 2 min stop at each point*, *dwell one minute at each gate*."""
        reader = self._reader
        led = bool(reader.take_in(_DWELL))
        reader.take("for", "of", "a", "an")
        seconds = read_duration(reader)
        if not seconds:
            return False
        led = bool(reader.take_in(_DWELL)) or led
        led = bool(reader.take(*_WORDS["each"])) or led
        if led:
            self._stay_s = seconds
        return led

    def _takes_way(self) -> bool:
        """Read *in any order*, *clockwise*, *begin with the west*."""
        reader = self._reader
        if reader.take(*_WORDS["any_order"]):
            self._any_order = True
        elif reader.take("clockwise"):
            self._turn = 1
        elif reader.take("anticlockwise", "counterclockwise", "counter-clockwise"):
            self._turn = -1
        elif reader.take(*_WORDS["begin"]) and (place := place_at(self._scene, reader)):
            self._first = place
            reader.take("one", "gate")
        else:
            return False
        return True

    def _takes_going(self) -> bool:
        reader = self._reader
        if reader.take(*_WORDS["go"]):
            self.goes = self.certain = True
            return True
        if not reader.take(*_WORDS["walk"]) or reader.word() in _WORDS["ways"]:
            return False
        # The places before the verb describe the asset: *the robot at the base*.
        self.goes, self.places = True, []
        return True

    def _takes_places(self) -> bool:
        reader = self._reader
        if reader.take(*_WORDS["every_gate"]):
            self.places += self._scene.gates
            return True
        place = place_at(self._scene, reader)
        if place:
            self.places.append(place)
            reader.take("gates")
        return bool(place)

    def _takes_asset(self) -> bool:
        reader = self._reader
        if name := asset_at(self._scene, reader):
            self._names.append(name)
            return True
        reader.take("ground", "flying", "aerial")
        word = reader.word()
        kind: AssetKind | None = KINDS.get(word) or ("ugv" if word == "vehicle" else None)
        if kind is None and word not in ASSETS | {"somebody", "someone", "anybody", "anyone"}:
            return False
        ground = reader.word(-1) == "ground"
        if kind is not None:
            self._kinds.append("ugv" if word == "vehicle" and ground else kind)
        reader.at += 1
        return True

    def patrol(self, limits: PatrolLimits) -> Patrol | Unclear:
        """Return the patrol, or a question about it."""
        if self._endless:
            problem = f"“{self._endless}”: a patrol must end after a number of laps, at most"
            return Unclear("", f"{problem} {limits.most_laps} (patrol_laps). How many?")
        if self._left:
            left = " ".join(self._left)
            problem = "Say who goes, where, how many laps, and how long at each place."
            return Unclear("", f"“{left}” is not understood in a patrol. {problem}")
        if self._laps > limits.most_laps:
            most = f"at most {limits.most_laps} laps (patrol_laps)"
            return Unclear("", f"{self._laps} laps are too many: {most}. How many?")
        several = {*self._names}, {*self._kinds}
        if len(several[0]) > 1 or (not self._names and len(several[1]) > 1):
            assets = " and ".join((*self._names, *self._kinds))
            return Unclear("", f"{assets}: one asset goes on a patrol. Which one?")
        places = self._in_order()
        stay_s = self._stay_s if self._stay_s >= 0.0 else limits.stay_s
        name = self._names[0] if self._names else ""
        kind = None if name else next(iter(self._kinds), None)
        return Patrol(places, self._laps or 1, stay_s, name, kind, self._any_order)

    def _in_order(self) -> tuple[str, ...]:
        """Return the places in the order of the visits, each once per lap."""
        places = list(dict.fromkeys(self.places))
        if self._turn:
            places.sort(key=self._angle, reverse=self._turn > 0)
        if self._first in places:
            at = places.index(self._first)
            places = places[at:] + places[:at]
        elif self._first:
            places.insert(0, self._first)
        return tuple(places)

    def _angle(self, place: str) -> float:
        """Return the direction of a place from the middle of all gates, in radians from south."""
        spots = [self._scene.spot(gate) for gate in self._scene.gates]
        x, y = (sum(coordinates) / len(spots) for coordinates in zip(*spots, strict=True))
        at = self._scene.spot(place)
        return math.atan2(at[0] - x, -(at[1] - y)) % (2 * math.pi)


def legs_of(patrol: Patrol, scene: ReferenceScene, agent: str) -> tuple[str, ...]:
    """Return the places of all laps in order; with `any_order`, the nearest place comes first."""
    order = list(patrol.places)
    if patrol.any_order:
        order, left, here = [], list(patrol.places), agent
        while left:
            here = min(left, key=lambda place, here=here: scene.distance_m(here, place))
            left.remove(here)
            order.append(here)
    return tuple(order * patrol.laps)


def least_s(patrol: Patrol, scene: ReferenceScene) -> float:
    """Return the shortest time of a patrol in seconds: straight legs at full speed, and stays."""
    world = scene.world
    kinds = {world.assets[patrol.asset].kind} if patrol.asset in world.assets else {patrol.kind}
    speeds = [p.speed_mps for kind, p in world.platforms.items() if kinds & {kind, None}]
    legs = patrol.places * patrol.laps
    way_m = sum(scene.distance_m(start, end) for start, end in pairwise(legs))
    return way_m / max(speeds) + patrol.stay_s * (len(legs) - 1)
