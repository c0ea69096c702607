"""Clauses about an asset after its noun: *at the base, that guards a gate, I sent last*."""

from collections.abc import Callable

from pa_console.language.references.description import Trait
from pa_console.language.references.traits import (
    Told,
    Way,
    has_failed,
    is_guard,
    is_idle,
    is_low,
    is_silent,
    may_leave,
    works,
)
from pa_console.language.references.words import (
    BUT,
    FAILED,
    GUARDING,
    IDLE,
    IN,
    SAYING,
    SENT,
    SILENT,
    STANDING,
    asset_at,
    place_at,
)

NounTraits = Callable[[], list[Trait]]
"""Reads another noun phrase and returns its traits; none if there is none here."""


class AssetClauses:
    """Reads clauses in sequence and collects their facts in `told`."""

    def __init__(self, told: Told, noun_traits: NounTraits) -> None:
        self._told, self._noun_traits = told, noun_traits
        self._scene, self._reader = told.scene, told.reader
        self._related = self._no = False
        self._start = 0

    def read(self) -> bool:
        """Read one clause; False where none is here, or none that is understood."""
        reader, told = self._reader, self._told
        self._start, self._no = reader.at, False
        if reader.take(*BUT):
            return self._excluded()
        if told.ranked() or self._sent_before():
            return True
        self._related = bool(reader.take("that", "which", "who"))
        if self._related and self._sent_before():
            return True
        if not self._related and reader.word() in SAYING | {"does", "do"}:
            return False
        reader.skip(STANDING)
        self._no = bool(reader.take("does not", "do not", "not", "without", "never"))
        reader.skip(STANDING)
        if self._related and told.ranked():
            return True
        ways: tuple[Way, ...] = (self._guarding, self._possessed, self._located, self._state)
        return any(way() for way in ways)

    def _say(self, trait: Trait) -> bool:
        return self._told.say(trait, no=self._no)

    def _excluded(self) -> bool:
        """Read the excluded assets: *but the guards*, *except Drone_T04 and Robot_T01*."""
        names: set[str] = set()
        while name := asset_at(self._scene, self._reader):
            names.add(name)
            self._reader.take("and", ",")
        if names:
            return self._told.say(lambda _, n: n not in names)
        traits = self._noun_traits()
        if not traits:
            return False
        return self._told.say(lambda s, n: not all(trait(s, n) for trait in traits))

    def _sent_before(self) -> bool:
        """Read *I sent last*, *we just moved*, *I moved first*, *I sent to the east gate*."""
        reader = self._reader
        start = reader.at
        if not reader.take("i", "we", "you"):
            return False
        reader.take("have", "'ve")
        early = bool(reader.take("first"))
        reader.take("just", "last", "only just")
        if not reader.take_in(SENT):
            reader.at = start
            return False
        early = bool(reader.take("first")) or early
        reader.take("last", "just now", "before")
        place = place_at(self._scene, reader) if reader.take("to", "over to") else ""
        if not self._told.past:
            sent(self._told, place, early=early)
        return True

    def _guarding(self) -> bool:
        """Read the guarded gate: *guarding the west gate*, *cover a gate*."""
        reader, start = self._reader, self._reader.at
        if not reader.take_in(GUARDING):
            return False
        place = place_at(self._scene, reader)
        if place:
            self._told.place = self._told.place or place
            return self._say(lambda s, n: s.place_of(n) == place)
        if reader.take("nothing"):
            return self._told.say(is_guard, no=True)
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
            return self._told.say(is_idle)
        if reader.take("no gate to guard", "no gate", "no post"):
            return self._told.say(is_guard, no=True)
        if reader.take("a gate", "a post"):
            return self._say(is_guard)
        if self._company() and (self._related or reader.word(-1) == "gate"):
            return True
        reader.at = start
        return False

    def _company(self) -> bool:
        """Read who stands beside: *a drone at its gate*, *somebody*, *Drone_T01*."""
        reader, start = self._reader, self._reader.at
        if reader.take("somebody", "someone", "another", "anybody"):
            return self._told.say(lambda s, n: is_guard(s, n) and len(s.at(s.place_of(n))) > 1)
        name = asset_at(self._scene, reader)
        reader.take("a", "an", "one")
        team = frozenset((name,)) if name else self._scene.members(reader.word())
        if not team:
            reader.at = start
            return False
        reader.at += not name
        reader.take("at its gate", "at its side", "beside it", "there")
        return self._told.say(
            lambda s, n: any(o in team and o != n for o in s.at(s.place_of(n) or "-"))
        )

    def _located(self) -> bool:
        """Read the place of an asset: *at the base*, *at a gate*, *from the hub*."""
        reader, told = self._reader, self._told
        start = reader.at
        if told.ranking is not None and not self._related:
            return False
        if not reader.take_in(IN):
            return False
        if reader.take("a gate", "any gate", "gates", "the gates", "gate duty"):
            return self._say(is_guard)
        place = place_at(self._scene, reader)
        if not place:
            reader.at = start
            return False
        told.bare_location = not self._related and start == self._start
        told.place = told.place or place
        return self._say(lambda s, n: s.place_of(n) == place)

    def _state(self) -> bool:
        """Read the state of an asset, after *that* or *not*: *that is low*, *not answering*."""
        if not self._related and not self._no:
            return False
        reader = self._reader
        if reader.take("alone"):
            reader.take("at its gate", "at their gate", "there")
            self._say(lambda s, n: len(s.at(s.place_of(n))) < 2)
            return self._told.say(is_guard)
        if reader.take("shares its gate", "shares a gate", "share a gate"):
            self._told.say(is_guard)
            return bool(reader.take("with")) and self._company()
        if reader.take("can leave", "may leave"):
            reader.take("its gate", "its post", "its place")
            return self._say(may_leave)
        return self._condition()

    def _condition(self) -> bool:
        reader = self._reader
        if reader.take_in(IDLE) or reader.take("doing nothing"):
            return self._say(is_idle)
        if reader.take("doing anything"):
            return self._told.say(is_idle)
        if reader.take("running low", "low", "nearly flat", "almost empty", "almost flat"):
            reader.take("on battery", "on power", "on juice", "on charge")
            return self._say(is_low)
        if reader.take("still works", "works", "still working", "working"):
            return self._say(works)
        if reader.take_in(FAILED):
            return self._say(has_failed)
        answers = reader.take("answering", "answer", "responding", "respond", "reporting")
        if (self._no and answers) or reader.take_in(SILENT):
            return self._told.say(is_silent)
        return False


def sent(told: Told, place: str = "", *, early: bool) -> None:
    """Choose the asset sent last, or first, to `place` if given."""
    told.past = told.of_assets = True
    moves = [move for move in told.scene.moved if place in ("", move.target)]
    last = told.scene.last
    meant = [move.agent for move in (moves[:1] if early else moves[-1:])]
    if not early and last is not None and not place:
        meant = [move.agent for move in last.moves if move in moves]
    told.say(lambda _, name: name in meant)
