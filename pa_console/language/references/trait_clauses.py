"""Clauses after a noun: *the asset that guards a gate*, *the gate with only one guard*."""

from collections.abc import Callable

from pa_console.language.references import reader as words
from pa_console.language.references.description import (
    PartialDescription,
    Trait,
    Way,
    has_failed,
    is_bare,
    is_guard,
    is_idle,
    is_low,
    is_silent,
    may_leave,
    works,
)
from pa_console.language.references.reader import Reader, asset_at, number_of, place_at
from pa_console.language.references.scene import ReferenceScene

NounTraits = Callable[[], list[Trait]]
"""A function that reads another noun phrase and returns its traits; empty if there is none."""

_ON_IT = ("on it", "there", "at all", "looking after it", "watching it")


def place_of_owner(scene: ReferenceScene, reader: Reader) -> str | None:
    """Read *Drone_T01's gate*, *Drone_T01's old gate*, *the same gate as Drone_T01*.

    Returns the place of the asset; None if the words are not such a possessive.
    """
    start = reader.at
    reader.take("the")
    old = False
    if reader.take("same gate as", "same place as", "same post as"):
        name = asset_at(scene, reader)
    else:
        reader.at = start
        name = asset_at(scene, reader)
        owns = bool(name) and bool(reader.take("'s"))
        old = owns and bool(reader.take("old", "former", "previous"))
        name = name if owns and reader.take("gate", "post", "place") else ""
    if not name:
        reader.at = start
        return None
    before = [move.before for move in scene.moved if move.agent == name and move.before]
    return before[-1] if old and before else scene.place_of(name)


class AssetClauses:
    """A reader of successive clauses that collects their traits in `partial`."""

    def __init__(self, partial: PartialDescription, noun_traits: NounTraits) -> None:
        self._partial, self._noun_traits = partial, noun_traits
        self._scene, self._reader = partial.scene, partial.reader
        self._related = self._no = False
        self._start = 0

    def read(self) -> bool:
        """Read one clause; return False if no clause here is understood."""
        reader, partial = self._reader, self._partial
        self._start, self._no = reader.at, False
        if reader.take(*words.BUT):
            return self._excluded()
        if partial.ranked() or self._sent_before():
            return True
        self._related = bool(reader.take("that", "which", "who"))
        if self._related and self._sent_before():
            return True
        if not self._related and reader.word() in words.SAYING | {"does", "do"}:
            return False
        reader.skip(words.STANDING)
        self._no = bool(reader.take("does not", "do not", "not", "without", "never"))
        reader.skip(words.STANDING)
        if self._related and partial.ranked():
            return True
        ways: tuple[Way, ...] = (self._guarding, self._possessed, self._located, self._state)
        return any(way() for way in ways)

    def _say(self, trait: Trait) -> bool:
        return self._partial.say(trait, no=self._no)

    def _excluded(self) -> bool:
        """Read the excluded assets: *but the guards*, *except Drone_T04 and Robot_T01*."""
        names: set[str] = set()
        while name := asset_at(self._scene, self._reader):
            names.add(name)
            self._reader.take("and", ",")
        if names:
            return self._partial.say(lambda _, n: n not in names)
        traits = self._noun_traits()
        if not traits:
            return False
        return self._partial.say(lambda s, n: not all(trait(s, n) for trait in traits))

    def _sent_before(self) -> bool:
        """Read *I sent last*, *we just moved*, *I moved first*, *I sent to the east gate*."""
        reader = self._reader
        start = reader.at
        if not reader.take("i", "we", "you"):
            return False
        reader.take("have", "'ve")
        early = bool(reader.take("first"))
        reader.take("just", "last", "only just")
        if not reader.take_in(words.SENT):
            reader.at = start
            return False
        early = bool(reader.take("first")) or early
        reader.take("last", "just now", "before")
        place = place_at(self._scene, reader) if reader.take("to", "over to") else ""
        if not self._partial.past:
            sent(self._partial, place, early=early)
        return True

    def _guarding(self) -> bool:
        """Read the guarded gate: *guarding the west gate*, *cover a gate*."""
        reader, start = self._reader, self._reader.at
        finite = not self._related and not reader.word().endswith("ing")
        if finite or not reader.take_in(words.GUARDING):
            return False
        place = place_at(self._scene, reader)
        if place:
            self._partial.place = self._partial.place or place
            return self._say(lambda s, n: s.place_of(n) == place)
        if reader.take("nothing"):
            return self._partial.say(is_guard, no=True)
        if reader.take("a gate", "any gate", "anything", "any", "gates", "the gates"):
            return self._say(is_guard)
        reader.at = start
        return False

    def _possessed(self) -> bool:
        """Read *with nothing to do*, *that has no gate*, *with a drone at its gate*."""
        reader, start = self._reader, self._reader.at
        if not reader.take("with", "has", "have", "having"):
            return self._no and bool(reader.take("a gate", "any gate")) and self._say(is_guard)
        if reader.take("nothing to do", "nothing on", "no job", "no task"):
            return self._partial.say(is_idle)
        if reader.take("no gate to guard", "no gate", "no post"):
            return self._partial.say(is_guard, no=True)
        if reader.take("a gate", "a post"):
            return self._say(is_guard)
        if self._company() and (self._related or reader.word(-1) == "gate"):
            return True
        reader.at = start
        return False

    def _company(self) -> bool:
        """Read the assets at the same place: *a drone at its gate*, *somebody*, *Drone_T01*."""
        reader, start = self._reader, self._reader.at
        if reader.take("somebody", "someone", "another", "anybody"):
            return self._partial.say(lambda s, n: is_guard(s, n) and len(s.at(s.place_of(n))) > 1)
        name = asset_at(self._scene, reader)
        reader.take("a", "an", "one")
        team = frozenset((name,)) if name else self._scene.members(reader.word())
        if not team:
            reader.at = start
            return False
        reader.at += not name
        reader.take("at its gate", "at its side", "beside it", "there")
        return self._partial.say(
            lambda s, n: any(o in team and o != n for o in s.at(s.place_of(n) or "-"))
        )

    def _located(self) -> bool:
        """Read the place of an asset: *at the base*, *at a gate*, *from the hub*."""
        reader, partial = self._reader, self._partial
        start = reader.at
        if partial.ranking is not None and not self._related:
            return False
        if not reader.take_in(words.IN):
            return False
        if reader.take("a gate", "any gate", "gates", "the gates", "gate duty"):
            return self._say(is_guard)
        place = place_at(self._scene, reader)
        destined = (
            partial.put and not self._related and reader.word() not in ("to", "at", "on", "in")
        )
        if not place or destined:
            reader.at = start
            return False
        partial.bare_location = not self._related and start == self._start
        partial.place = partial.place or place
        return self._say(lambda s, n: s.place_of(n) == place)

    def _state(self) -> bool:
        """Read the state of an asset after *that* or *not*: *that is low*, *not answering*."""
        if not self._related and not self._no:
            return False
        reader = self._reader
        if reader.take("alone"):
            reader.take("at its gate", "at their gate", "there")
            self._say(lambda s, n: len(s.at(s.place_of(n))) < 2)
            return self._partial.say(is_guard)
        if reader.take("shares its gate", "shares a gate", "share a gate"):
            self._partial.say(is_guard)
            return bool(reader.take("with")) and self._company()
        if reader.take("can leave", "may leave"):
            reader.take("its gate", "its post", "its place")
            return self._say(may_leave)
        return self._condition()

    def _condition(self) -> bool:
        reader = self._reader
        if reader.take_in(words.IDLE) or reader.take("doing nothing"):
            return self._say(is_idle)
        if reader.take("doing anything"):
            return self._partial.say(is_idle)
        if reader.take("running low", "low", "nearly flat", "almost empty", "almost flat"):
            reader.take("on battery", "on power", "on juice", "on charge")
            return self._say(is_low)
        if reader.take("still works", "works", "still working", "working"):
            return self._say(works)
        if reader.take_in(words.FAILED):
            return self._say(has_failed)
        answers = reader.take("answering", "answer", "responding", "respond", "reporting")
        if (self._no and answers) or reader.take_in(words.SILENT):
            return self._partial.say(is_silent)
        return False


def sent(partial: PartialDescription, place: str = "", *, early: bool) -> None:
    """Add the trait that an asset was sent last, or first, to `place` if given."""
    partial.past = partial.of_assets = True
    moves = [move for move in partial.scene.moved if place in ("", move.target)]
    last = partial.scene.last
    agents = [move.agent for move in (moves[:1] if early else moves[-1:])]
    if not early and last is not None and not place:
        agents = [move.agent for move in last.moves if move in moves]
    partial.say(lambda _, name: name in agents)


class GateClauses:
    """A reader of successive clauses that collects their traits in `partial`."""

    def __init__(self, partial: PartialDescription) -> None:
        self._partial = partial
        self._scene, self._reader = partial.scene, partial.reader

    def read(self) -> bool:
        """Read one clause; return False if no clause here is understood."""
        reader = self._reader
        if self._partial.ranked():
            return True
        if reader.take("where"):
            return self._standing_asset()
        if reader.take("whose guard", "whose guards"):
            return self._of_guard()
        related = bool(reader.take("that", "which"))
        if related and self._somebody_guards():
            return True
        ways: tuple[Way, ...] = (lambda: self._covered(related), self._with, self._without)
        return any(way() for way in ways) or (related and self._visited())

    def _covered(self, related: bool) -> bool:
        """Read *guarded by a drone*, *that is not covered*, *nobody is guarding*."""
        reader, start = self._reader, self._reader.at
        if reader.take("nobody", "no one"):
            reader.skip(("is", "'s", "at", "there"))
            reader.take_in(words.GUARDING)
            return self._partial.say(is_bare)
        reader.skip(("is", "are", "'s", "currently", "still"))
        no = bool(reader.take("not"))
        if related and reader.take_in(words.BARE):
            return self._partial.say(is_bare, no=no)
        if reader.take_in(words.GUARDED):
            return self._by() if reader.take("by") else self._partial.say(is_bare, no=not no)
        reader.at = start
        return False

    def _without(self) -> bool:
        reader, start = self._reader, self._reader.at
        if reader.take("without"):
            reader.take("a", "any")
            if reader.take("guard", "guards", "anybody", "anyone", "cover", "one"):
                reader.take(*_ON_IT)
                return self._partial.say(is_bare)
        reader.at = start
        return False

    def _with(self) -> bool:
        return bool(self._reader.take("with", "has", "have", "having")) and self._by()

    def _by(self) -> bool:
        """Read the guards of a gate: *only one guard*, *nobody*, *a robot and a drone*."""
        reader, partial = self._reader, self._partial
        start = reader.at
        if reader.take("nobody", "no one", "no guard", "no guards", "no cover", "none"):
            reader.take(*_ON_IT)
            return partial.say(is_bare)
        alone = bool(reader.take("only", "just", "no more than"))
        number = self._how_many()
        alone = alone or reader.word(-1) == "single"
        if number >= 0 and reader.take_in(words.GUARDS):
            reader.take(*_ON_IT)
            return partial.say(lambda s, g: len(s.guards(g)) == number)
        teams = self._teams()
        reader.take(*_ON_IT)
        if not teams:
            reader.at = start
            return False
        most = max(number, 1)
        partial.say(lambda s, g: all(team & set(s.guards(g)) for team in teams))
        if number > 0:
            partial.say(lambda s, g: all(len(team & set(s.guards(g))) == most for team in teams))
        if alone:
            partial.say(lambda s, g: len(s.guards(g)) == len(teams) * most)
        return True

    def _how_many(self) -> int:
        """Read a number, an article or *a single*; return -1 if the number is open."""
        reader = self._reader
        if reader.take("a single", "the single", "single"):
            return 1
        if (number := number_of(reader.word())) >= 0:
            reader.at += 1
            return number
        reader.take("a", "an", "the")
        return -1

    def _teams(self) -> tuple[frozenset[str], ...]:
        """Read kinds or names: *a robot and a drone*, *Drone_T01*."""
        reader, teams = self._reader, list[frozenset[str]]()
        while True:
            name = asset_at(self._scene, reader)
            team = frozenset((name,)) if name else self._scene.members(reader.word())
            if not team:
                return tuple(teams)
            reader.at += not name
            teams.append(team)
            if not reader.take("and a", "and an", "and one", "and"):
                return tuple(teams)

    def _somebody_guards(self) -> bool:
        """Read *Drone_T01 is guarding*, *a drone watches*."""
        reader, start = self._reader, self._reader.at
        name = asset_at(self._scene, reader)
        reader.take("a", "an", "one", "the")
        team = frozenset((name,)) if name else self._scene.members(reader.word())
        if team:
            reader.at += not name
            reader.skip(("is", "'s", "currently"))
            if reader.take_in(words.GUARDING) or reader.take("at", "stands at", "on"):
                return self._partial.say(lambda s, g: bool(team & set(s.stationed(g))))
        reader.at = start
        return False

    def _standing_asset(self) -> bool:
        """Read *where Drone_T01 stands*, *where both A and B are*, *where the truck is*."""
        reader, start = self._reader, self._reader.at
        reader.take("both")
        names: list[str] = []
        while name := asset_at(self._scene, reader):
            names.append(name)
            reader.take("and", ",")
        if names:
            reader.skip(words.STANDING)
            return self._partial.say(lambda s, g: all(n in s.stationed(g) for n in names))
        reader.at = start
        return self._visited()

    def _visited(self) -> bool:
        """Read the contact at a gate: *the truck is*, *the stranger is walking towards*."""
        reader, start = self._reader, self._reader.at
        reader.take("the", "a", "that", "this", "an")
        reader.take("unknown", "strange", "suspicious")
        word = reader.take_in(words.CONTACTS)
        if not word:
            reader.at = start
            return False
        kind = words.CONTACTS[word]
        reader.skip(words.COMING)
        return self._partial.say(lambda s, g: any(t.gate == g for t in s.visitors(kind)))

    def _of_guard(self) -> bool:
        """Read the state of a gate's guard: *is low on battery*, *has failed*, *is silent*."""
        reader = self._reader
        reader.skip(("is", "are", "'s", "has", "runs", "running", "gone"))
        no = bool(reader.take("not"))
        trait: Trait
        if reader.take("low", "nearly flat", "almost empty"):
            reader.take("on battery", "on power", "on juice", "on charge")
            trait = is_low
        elif reader.take_in(words.FAILED):
            trait = has_failed
        elif reader.take_in(words.SILENT) or (no and reader.take("answering", "responding")):
            trait = is_silent
        else:
            return False
        return self._partial.say(lambda s, g: any(trait(s, n) for n in s.stationed(g)))
