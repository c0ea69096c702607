"""Clauses about a gate after its noun: *with only one guard*, *where the truck is*."""

from pa_console.language.references.description import Trait
from pa_console.language.references.traits import (
    Told,
    Way,
    has_failed,
    is_bare,
    is_low,
    is_silent,
)
from pa_console.language.references.words import (
    BARE,
    COMING,
    CONTACTS,
    FAILED,
    GUARDED,
    GUARDING,
    GUARDS,
    SILENT,
    STANDING,
    asset_at,
    number_of,
)

_ON_IT = ("on it", "there", "at all", "looking after it", "watching it")


class GateClauses:
    """Reads clauses in sequence and collects their facts in `told`."""

    def __init__(self, told: Told) -> None:
        self._told = told
        self._scene, self._reader = told.scene, told.reader

    def read(self) -> bool:
        """Read one clause; False where none is here, or none that is understood."""
        reader = self._reader
        if self._told.ranked():
            return True
        if reader.take("where"):
            return self._where()
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
            reader.take_in(GUARDING)
            return self._told.say(is_bare)
        reader.skip(("is", "are", "'s", "currently", "still"))
        no = bool(reader.take("not"))
        if related and reader.take_in(BARE):
            return self._told.say(is_bare, no=no)
        if reader.take_in(GUARDED):
            return self._by() if reader.take("by") else self._told.say(is_bare, no=not no)
        reader.at = start
        return False

    def _without(self) -> bool:
        reader, start = self._reader, self._reader.at
        if reader.take("without"):
            reader.take("a", "any")
            if reader.take("guard", "guards", "anybody", "anyone", "cover", "one"):
                reader.take(*_ON_IT)
                return self._told.say(is_bare)
        reader.at = start
        return False

    def _with(self) -> bool:
        return bool(self._reader.take("with", "has", "have", "having")) and self._by()

    def _by(self) -> bool:
        """Read who guards a gate: *only one guard*, *nobody*, *a robot and a drone*."""
        reader, told = self._reader, self._told
        start = reader.at
        if reader.take("nobody", "no one", "no guard", "no guards", "no cover", "none"):
            reader.take(*_ON_IT)
            return told.say(is_bare)
        alone = bool(reader.take("only", "just", "no more than"))
        number = self._how_many()
        alone = alone or reader.word(-1) == "single"
        if number >= 0 and reader.take_in(GUARDS):
            reader.take(*_ON_IT)
            return told.say(lambda s, g: len(s.guards(g)) == number)
        teams = self._teams()
        reader.take(*_ON_IT)
        if not teams:
            reader.at = start
            return False
        most = max(number, 1)
        told.say(lambda s, g: all(team & set(s.guards(g)) for team in teams))
        if number > 0:
            told.say(lambda s, g: all(len(team & set(s.guards(g))) == most for team in teams))
        if alone:
            told.say(lambda s, g: len(s.guards(g)) == len(teams) * most)
        return True

    def _how_many(self) -> int:
        """Read a number, an article or *a single*; -1 where the number is left open."""
        reader = self._reader
        if reader.take("a single", "the single", "single"):
            return 1
        if (number := number_of(reader.word())) >= 0:
            reader.at += 1
            return number
        reader.take("a", "an", "the")
        return -1

    def _teams(self) -> tuple[frozenset[str], ...]:
        """Read kinds, or names: *a robot and a drone*, *Drone_T01*."""
        reader, found = self._reader, list[frozenset[str]]()
        while True:
            name = asset_at(self._scene, reader)
            team = frozenset((name,)) if name else self._scene.members(reader.word())
            if not team:
                return tuple(found)
            reader.at += not name
            found.append(team)
            if not reader.take("and a", "and an", "and one", "and"):
                return tuple(found)

    def _somebody_guards(self) -> bool:
        """Read *Drone_T01 is guarding*, *a drone watches*."""
        reader, start = self._reader, self._reader.at
        name = asset_at(self._scene, reader)
        reader.take("a", "an", "one", "the")
        team = frozenset((name,)) if name else self._scene.members(reader.word())
        if team:
            reader.at += not name
            reader.skip(("is", "'s", "currently"))
            if reader.take_in(GUARDING) or reader.take("at", "stands at", "on"):
                return self._told.say(lambda s, g: bool(team & set(s.stationed(g))))
        reader.at = start
        return False

    def _where(self) -> bool:
        """Read *where Drone_T01 stands*, *where both A and B are*, *where the truck is*."""
        reader, start = self._reader, self._reader.at
        reader.take("both")
        names: list[str] = []
        while name := asset_at(self._scene, reader):
            names.append(name)
            reader.take("and", ",")
        if names:
            reader.skip(STANDING)
            return self._told.say(lambda s, g: all(n in s.stationed(g) for n in names))
        reader.at = start
        return self._visited()

    def _visited(self) -> bool:
        """Read what comes to a gate: *the truck is*, *the stranger is walking towards*."""
        reader, start = self._reader, self._reader.at
        reader.take("the", "a", "that", "this", "an")
        reader.take("unknown", "strange", "suspicious")
        word = reader.take_in(CONTACTS)
        if not word:
            reader.at = start
            return False
        kind = CONTACTS[word]
        reader.skip(COMING)
        return self._told.say(lambda s, g: any(t.gate == g for t in s.visitors(kind)))

    def _of_guard(self) -> bool:
        """Read how the guard of a gate is: *is low on battery*, *has failed*, *is silent*."""
        reader = self._reader
        reader.skip(("is", "are", "'s", "has", "runs", "running", "gone"))
        no = bool(reader.take("not"))
        trait: Trait
        if reader.take("low", "nearly flat", "almost empty"):
            reader.take("on battery", "on power", "on juice", "on charge")
            trait = is_low
        elif reader.take_in(FAILED):
            trait = has_failed
        elif reader.take_in(SILENT) or (no and reader.take("answering", "responding")):
            trait = is_silent
        else:
            return False
        return self._told.say(lambda s, g: any(trait(s, n) for n in s.stationed(g)))
