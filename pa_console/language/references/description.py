"""Definite descriptions with their traits, and the sets of assets or gates in an order.

An example is *of the two robots, the one with more battery goes north, the other one stays*. A set
is a list of names or a plural noun. *The one that*, *whichever*, *the latter* and *the other one*
pick from the set that was introduced last.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from pa_console.language.lexicon import word_lists
from pa_console.language.references import reader as words
from pa_console.language.references.reader import Reader, WordToken, asset_at, place_at
from pa_console.language.references.scene import ReferenceScene

Sort = Literal["gate", "asset"]
Trait = Callable[[ReferenceScene, str], bool]
"""A function that returns whether the asset or gate of that name has the trait."""
By = Literal["near", "far", "full", "flat"]
"""The measure of a superlative: a short or long distance, a full or flat battery."""
_TIE: dict[By, float] = {"near": 3.0, "far": 3.0, "full": 1.0, "flat": 1.0}
"""The difference, in metres or percent, within which two members fit a superlative equally well."""

_WORDS = word_lists("groups")
OF = _WORDS["of"]
"""The words before a set: *of the two robots*."""
DETERMINERS = _WORDS["determiners"]
_ONE_OF = _WORDS["one_of"]
_JOINTS = (*_WORDS["joints"], ",", "/", "&")
_ORDINALS = {word: place for place, word in enumerate(_WORDS["ordinals"])}
_MEMORY = 2
"""The number of past missions to which *the drone* can refer."""
_CLAUSE = frozenset(_WORDS["clause"])

Way = Callable[[], bool]
"""A function that reads one trait and returns whether there was one."""


@dataclass(frozen=True)
class Superlative:
    """A superlative, which selects the fitting asset or gate that is best by its measure."""

    by: By
    place: str = ""
    """The frame or asset from which distances are measured; '' if it is not given."""

    @property
    def distance(self) -> bool:
        """True if the measure is a distance."""
        return self.by in ("near", "far")

    def measure(self, scene: ReferenceScene, name: str) -> float:
        """Return the measure of an asset or gate, in metres or percent; the smallest is best."""
        match self.by:
            case "near":
                return scene.distance_m(self.place, name)
            case "far":
                return -scene.distance_m(self.place, name)
            case "full":
                return -scene.asset(name).battery_pct
            case "flat":
                return scene.asset(name).battery_pct


@dataclass
class Group:
    """A set of assets or gates introduced by an order, and the members `picked` so far.

    `members` are in the order of the words; the words are the characters from `start` to `end`.
    """

    members: tuple[str, ...]
    sort: Sort
    start: int = 0
    end: int = 0
    leading: bool = False
    """True if the set begins a clause: *of the two robots,* is removed when a member is picked."""
    choice: bool = False
    """True if any member will do: *Drone_T04 or Ugv_T02*, *a robot*."""
    clear: bool = True
    """False if its number does not match the picture: *the two drones*, if there are four."""
    mentioned: bool = True
    """False if the set is made of the assets that moved last, which the order does not mention."""
    picked: set[str] = field(default_factory=set[str])
    bound: bool = False
    """True if a description has picked from the set."""


@dataclass(frozen=True)
class Description:
    """A description of gates or assets, in the characters from `start` to `end` of an order.

    `number` is the number of assets or gates that are meant; 0 means all that fit. With
    `any_will_do`, any one that fits may be used. `place` is a frame named in the words. A
    description without a noun picks from `group`.
    """

    start: int
    end: int
    words: str
    sort: Sort
    traits: tuple[Trait, ...] = ()
    ranking: Superlative | None = None
    number: int = 1
    any_will_do: bool = False
    place: str = ""
    group: Group | None = None
    selects: bool = False
    """True if it only picks from the group: *A or B, whichever is nearer*."""


def fitting(scene: ReferenceScene, description: Description) -> tuple[str, ...]:
    """Return the names that fit, in the order of the world; with a superlative, only the best.

    If several are equally good, all of them are returned. If the description picks from a group
    that the order does not mention, and no member fits, other assets may fit.
    """
    names: Sequence[str] = (
        scene.gates if description.sort == "gate" else tuple(scene.picture.assets)
    )
    fit = [name for name in names if all(trait(scene, name) for trait in description.traits)]
    if (group := description.group) is not None:
        within = [name for name in fit if name in group.members]
        fit = within if within or group.mentioned else fit
    ranking = description.ranking
    if ranking is None or not fit:
        return tuple(fit)
    best = min(ranking.measure(scene, name) for name in fit)
    return tuple(n for n in fit if ranking.measure(scene, n) <= best + _TIE[ranking.by])


@dataclass
class PartialDescription:
    """A description while it is read, with its traits so far."""

    scene: ReferenceScene
    reader: Reader
    sort: Sort = "asset"
    traits: list[Trait] = field(default_factory=list[Trait])
    ranking: Superlative | None = None
    place: str = ""
    """A frame named in the description."""
    describes: bool = False
    """True if the words are more than a noun."""
    past: bool = False
    """True if the description refers to an earlier order."""
    of_assets: bool = False
    """True if a trait applies only to assets."""
    put: bool = False
    """True after *put* and similar verbs: *at the south gate* is the destination, unless a place
    follows."""
    bare_location: bool = False
    """True if a place is named without *is* or a similar word: *everybody at the hub*."""

    def say(self, trait: Trait, *, no: bool = False) -> bool:
        """Add a trait, or with `no` its opposite; return True."""
        self.traits.append((lambda scene, name: not trait(scene, name)) if no else trait)
        self.describes = True
        return True

    def rank(self, ranking: Superlative) -> bool:
        """Add a superlative; return True."""
        self.ranking, self.describes = ranking, True
        return True

    def by_distance(self) -> bool:
        """Read *nearest to the base* or *furthest away*; return False if there is neither."""
        reader = self.reader
        near = bool(reader.take_in(words.NEAR))
        if not near and not reader.take_in(words.FAR):
            return False
        self.rank(Superlative("near" if near else "far"))
        self.from_where()
        return True

    def from_where(self) -> None:
        """Read the origin of a distance, if there is one: *to the base*, *away from Drone_T01*."""
        reader, scene, ranking = self.reader, self.scene, self.ranking
        if ranking is None or not ranking.distance or ranking.place:
            return
        start = reader.at
        reader.take("away")
        reader.take("to", "from")
        name = place_at(scene, reader) or asset_at(scene, reader)
        if not name:
            reader.at = start
            return
        self.place = name if name in scene.world.frames else ""
        self.ranking = Superlative(ranking.by, name)

    def ranked(self) -> bool:
        """Read *nearest to the base*, *with the fullest battery*, *that has less battery left*."""
        reader = self.reader
        start = reader.at
        reader.take("that", "which", "who")
        reader.skip(("is", "are", "'s", "'re"))
        if self.by_distance():
            return True
        if reader.take("with", "has", "have", "having"):
            reader.take("the")
            by = (
                "full"
                if reader.take_in(words.MOST)
                else "flat"
                if reader.take_in(words.LEAST)
                else None
            )
            if by is not None and self.sort == "asset" and reader.take_in(words.CHARGE):
                reader.take("level")
                reader.take("left", "remaining")
                if reader.take("among the", "of the", "of all"):
                    self._among()
                return self.rank(Superlative(by))
        reader.at = start
        return False

    @property
    def only_idle(self) -> bool:
        """True if the words ask only for an idle asset, of a team or of any."""
        idle_traits = [trait for trait in self.traits if trait in (is_idle, works)]
        team = len(self.traits) - len(idle_traits) <= 1
        return is_idle in idle_traits and team and self.ranking is None and not self.place

    def fits_one_of(self, rest: Group) -> bool:
        """Return whether a remaining member of a set has the traits read so far."""
        return rest.sort == self.sort and any(
            all(trait(self.scene, name) for trait in self.traits)
            for name in rest.members
            if name not in rest.picked
        )

    def _among(self) -> None:
        """Read the group to choose from: *among the drones*."""
        if team := self.scene.members(self.reader.word()):
            self.reader.at += 1
            self.traits.append(lambda _, name: name in team)


def works(scene: ReferenceScene, name: str) -> bool:
    """Return whether an asset is available."""
    return scene.asset(name).available


def is_idle(scene: ReferenceScene, name: str) -> bool:
    """Return whether an asset is idle: free and without a gate."""
    return scene.is_free(name) and not scene.guarded_by(name)


def may_leave(scene: ReferenceScene, name: str) -> bool:
    """Return whether an asset may leave without uncovering a gate or giving up its task."""
    return scene.is_free(name)


def is_low(scene: ReferenceScene, name: str) -> bool:
    """Return whether the battery of an asset is low."""
    return scene.asset(name).low_battery


def has_failed(scene: ReferenceScene, name: str) -> bool:
    """Return whether an asset has failed."""
    return scene.asset(name).status == "failed"


def is_silent(scene: ReferenceScene, name: str) -> bool:
    """Return whether an asset is silent without having reported a failure."""
    asset = scene.asset(name)
    return asset.status != "failed" and (asset.comms == "lost" or asset.stale)


def is_guard(scene: ReferenceScene, name: str) -> bool:
    """Return whether an asset has its post at a gate."""
    return bool(scene.guarded_by(name))


def is_bare(scene: ReferenceScene, gate: str) -> bool:
    """Return whether a gate has no guard."""
    return not scene.guards(gate)


class ReadSet(NamedTuple):
    """A set of assets or gates that ends before token `end`.

    `clear` is False if the words give a number that does not match the picture.
    """

    members: tuple[str, ...]
    sort: Sort
    end: int
    clear: bool = True
    choice: bool = False
    """True if any member will do: *Drone_T04 or Ugv_T02*, *a robot*."""


@dataclass
class SentenceGroups:
    """The sets and the mentioned assets in the part of an order that has been read.

    If the order has introduced no set, descriptions pick from the assets that the last mission
    moved, if there were several.
    """

    scene: ReferenceScene
    tokens: Sequence[WordToken]
    current: Group | None = None
    opened: list[Group] = field(default_factory=list[Group])
    """All sets that the order has introduced."""
    latest: tuple[str, ...] = ()
    """The assets mentioned last; at the start, those that the last mission moved."""
    named: set[str] = field(default_factory=set[str])
    """The assets mentioned in the order so far."""

    def __post_init__(self) -> None:
        last = self.scene.last
        agents = dict.fromkeys(move.agent for move in last.moves) if last is not None else ()
        self.latest = tuple(name for name in agents if name in self.scene.world.assets)
        if len(self.latest) > 1:
            self.current = Group(self.latest, "asset", mentioned=False)
            self.opened.append(self.current)

    @property
    def open(self) -> Group | None:
        """The set that was introduced last; None if all its members have been picked."""
        group = self.current
        return group if group is not None and len(group.picked) < len(group.members) else None

    @property
    def rest(self) -> Group | None:
        """The last set of which some members have been picked, but not all."""
        picked = (g for g in reversed(self.opened) if 0 < len(g.picked) < len(g.members))
        return next(picked, None)

    def last_mentioned(self, team: Collection[str]) -> frozenset[str]:
        """Return the assets of `team` mentioned last, in the order or in the last two missions."""
        past = [mission for mission in self.scene.past if not mission.undid]
        turns = [{move.agent for move in mission.moves} for mission in past[: -_MEMORY - 1 : -1]]
        mentioned = (frozenset(team) & turn for turn in (self.named, *turns))
        return next(filter(None, mentioned), frozenset[str]())

    def begins_clause(self, at: int) -> bool:
        """Return whether a clause begins at token `at`."""
        before = self.tokens[at - 1].word if at else "."
        return not before[0].isalnum() or before in _CLAUSE

    def in_order(self, word: str) -> str:
        """Return the member of the set that an ordinal means: *the former*, *the second*; or ''.

        *The first* refers to the set only if the order also has *the second* or *the other*.
        """
        group = self.current
        if group is None or word not in (*_ORDINALS, "former", "latter"):
            return ""
        sentence_words = {token.word for token in self.tokens}
        if word == "latter":
            return group.members[-1]
        place = _ORDINALS.get(word, 0)
        alone = word == "first" and not sentence_words & {
            "second",
            "other",
            "others",
            "latter",
            "rest",
        }
        return "" if alone or place >= len(group.members) else group.members[place]

    def introduce(self, read_set: ReadSet, first: int) -> None:
        """Introduce a set, whose words are the tokens from `first` to the end of `read_set`."""
        leading = self.begins_clause(first) and bool(Reader(self.tokens, first).take(*OF))
        end = read_set.end
        stop, then = ([token.word for token in self.tokens[end : end + 2]] + ["", ""])[:2]
        if stop == ":" and self.begins_clause(first - 1) and not self.begins_clause(first):
            first, leading = first - 1, True
        elif stop in (":", "-", "–") or (stop == "," and read_set.choice and then != "whichever"):
            leading = self.begins_clause(first)
        end += leading and stop in (",", ":", "-", "–")
        before = max((n for n in range(1, 3) if self._one_of(first - n) == first), default=0)
        self.current = Group(
            read_set.members,
            read_set.sort,
            self.tokens[first - before].start,
            self.tokens[end - 1].end,
            clear=read_set.clear,
            leading=leading,
            choice=read_set.choice or before > 0,
        )
        self.opened.append(self.current)
        if not read_set.choice:
            self._note(read_set.members)

    def _one_of(self, at: int) -> int:
        reader = Reader(self.tokens, max(at, 0))
        return reader.at if at >= 0 and reader.take(*_ONE_OF) else -1

    def mention(self, description: Description, names: Sequence[str]) -> None:
        """Record that the description `description` means `names`."""
        if description.group is not None:
            description.group.bound = True
        if self.current is not None and description.group is None and len(names) > 1:
            self.opened.append(
                Group(tuple(names), description.sort, description.start, description.end)
            )
            self.current = self.opened[-1]
        self._pick(names)

    def _pick(self, names: Sequence[str]) -> None:
        for group in self.opened:
            group.picked.update(set(names) & {*group.members})
        self._note(names)

    def _note(self, names: Sequence[str]) -> None:
        self.latest = tuple(name for name in names if name in self.scene.world.assets)
        self.named.update(self.latest)

    def read_name(self, at: int) -> int:
        """Read the name of an asset at token `at`, if there is one; return the next token."""
        reader = Reader(self.tokens, at)
        if name := asset_at(self.scene, reader):
            self._pick((name,))
        return at + 1

    def read_names(self, at: int) -> ReadSet | None:
        """Read a list of two or more asset names at token `at`; return None if there is none."""
        reader, end = Reader(self.tokens, at), at
        names = list[str]()
        choice = False
        while name := asset_at(self.scene, reader):
            names.append(name)
            end = reader.at
            while joint := reader.take(*_JOINTS):
                choice = choice or (joint == "or" and reader.written() in self.scene.world.assets)
        return ReadSet(tuple(names), "asset", end, choice=choice) if len(names) > 1 else None
