"""Sets of assets or gates introduced by an order, and the members picked from them so far.

*Of the two robots, the one with more battery goes north, the other one stays*: a set is a list of
names or a plural noun; *the one that*, *whichever*, *the latter*, *the other one* pick from the
set that was introduced last.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from pa_console.language.lexicon import word_lists
from pa_console.language.references.description import Description, Group, Sort
from pa_console.language.references.reader import Reader, WordToken, asset_at
from pa_console.language.references.scene import ReferenceScene

_WORDS = word_lists("groups")
OF = _WORDS["of"]
"""The words that lead to a set: *of the two robots*."""
DETERMINERS = _WORDS["determiners"]
_ONE_OF = _WORDS["one_of"]
_JOINTS = (*_WORDS["joints"], ",", "/", "&")
_ORDINALS = {word: place for place, word in enumerate(_WORDS["ordinals"])}
_MEMORY = 2
"""The number of past missions that *the drone* can refer to."""
_CLAUSE = frozenset(_WORDS["clause"])


class ReadSet(NamedTuple):
    """A set as it is read, up to the token `end`; not `clear` if its number does not fit."""

    members: tuple[str, ...]
    sort: Sort
    end: int
    clear: bool = True
    choice: bool = False
    """True if any one of it will do: *Drone_T04 or Ugv_T02*, *a robot*."""


@dataclass
class SentenceGroups:
    """The sets of an order, and the assets that it has mentioned, up to the place that is read.

    An order that has introduced no set picks from those that the last mission moved, if several.
    """

    scene: ReferenceScene
    tokens: Sequence[WordToken]
    current: Group | None = None
    opened: list[Group] = field(default_factory=list[Group])
    """All sets that the order has introduced."""
    latest: tuple[str, ...] = ()
    """The assets mentioned last; before any, those that the last mission moved."""
    named: set[str] = field(default_factory=set[str])
    """The assets mentioned in the order so far."""

    def __post_init__(self) -> None:
        last = self.scene.last
        agents = dict.fromkeys(move.agent for move in last.moves) if last is not None else ()
        self.latest = tuple(name for name in agents if name in self.scene.world.assets)
        if len(self.latest) > 1:
            self.current = Group(self.latest, "asset", spoken=False)
            self.opened.append(self.current)

    @property
    def open(self) -> Group | None:
        """The set that was introduced last, None if nothing is left of it."""
        group = self.current
        return group if group is not None and len(group.picked) < len(group.members) else None

    @property
    def rest(self) -> Group | None:
        """The last set with some members picked and some left."""
        picked = (g for g in reversed(self.opened) if 0 < len(g.picked) < len(g.members))
        return next(picked, None)

    def spoken_of(self, team: Collection[str]) -> frozenset[str]:
        """Return who of a `team` was spoken of last: in the order, or in the last two missions."""
        past = [mission for mission in self.scene.past if not mission.undid]
        turns = [{move.agent for move in mission.moves} for mission in past[: -_MEMORY - 1 : -1]]
        found = (frozenset(team) & turn for turn in (self.named, *turns))
        return next(filter(None, found), frozenset[str]())

    def begins_clause(self, at: int) -> bool:
        """Return whether a clause begins at token `at`."""
        before = self.tokens[at - 1].word if at else "."
        return not before[0].isalnum() or before in _CLAUSE

    def in_order(self, word: str) -> str:
        """Return which member of the set an ordinal means: *the former*, *the second*; '' for none.

        *The first* is of the set only beside *the second*, *the other*.
        """
        group = self.current
        if group is None or word not in (*_ORDINALS, "former", "latter"):
            return ""
        told = {token.word for token in self.tokens}
        if word == "latter":
            return group.members[-1]
        place = _ORDINALS.get(word, 0)
        alone = word == "first" and not told & {"second", "other", "others", "latter", "rest"}
        return "" if alone or place >= len(group.members) else group.members[place]

    def introduce(self, found: ReadSet, first: int) -> None:
        """Begin a set whose words are the tokens from `first` up to the end of `found`."""
        leading = self.begins_clause(first) and bool(Reader(self.tokens, first).take(*OF))
        end = found.end
        stop, then = ([token.word for token in self.tokens[end : end + 2]] + ["", ""])[:2]
        if stop == ":" and self.begins_clause(first - 1) and not self.begins_clause(first):
            first, leading = first - 1, True
        elif stop in (":", "-", "–") or (stop == "," and found.choice and then != "whichever"):
            leading = self.begins_clause(first)
        end += leading and stop in (",", ":", "-", "–")
        before = max((n for n in range(1, 3) if self._one_of(first - n) == first), default=0)
        self.current = Group(
            found.members,
            found.sort,
            self.tokens[first - before].start,
            self.tokens[end - 1].end,
            clear=found.clear,
            leading=leading,
            choice=found.choice or before > 0,
        )
        self.opened.append(self.current)
        if not found.choice:
            self._note(found.members)

    def _one_of(self, at: int) -> int:
        reader = Reader(self.tokens, max(at, 0))
        return reader.at if at >= 0 and reader.take(*_ONE_OF) else -1

    def mention(self, one: Description, names: Sequence[str]) -> None:
        """Note that the description `one` means `names`."""
        if one.group is not None:
            one.group.bound = True
        if self.current is not None and one.group is None and len(names) > 1:
            self.opened.append(Group(tuple(names), one.sort, one.start, one.end))
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
        """Read the name of an asset at token `at`; returns the next token."""
        reader = Reader(self.tokens, at)
        if name := asset_at(self.scene, reader):
            self._pick((name,))
        return at + 1

    def read_names(self, at: int) -> ReadSet | None:
        """Read a list of two or more asset names at token `at`, None where there is none."""
        reader, end = Reader(self.tokens, at), at
        names = list[str]()
        choice = False
        while name := asset_at(self.scene, reader):
            names.append(name)
            end = reader.at
            while joint := reader.take(*_JOINTS):
                choice = choice or (joint == "or" and reader.said() in self.scene.world.assets)
        return ReadSet(tuple(names), "asset", end, choice=choice) if len(names) > 1 else None
