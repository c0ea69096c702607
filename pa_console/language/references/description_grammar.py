"""Reads definite descriptions out of an order: *the gate with only one guard*, *both robots*.

A description is a determiner, adjectives, a noun, and what is said after it: with what, where, who
guards it, how near it is. The grammar is written by hand and read from left to right; words that it
does not know end a description, and are never passed over.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from pa_console.language.mentions import ASSETS
from pa_console.language.references import reader as words
from pa_console.language.references.description import (
    Description,
    PartialDescription,
    Superlative,
    Trait,
    has_failed,
    is_bare,
    is_guard,
    is_idle,
    is_low,
    is_silent,
    works,
)
from pa_console.language.references.reader import Reader, WordToken, asset_at, number_of
from pa_console.language.references.scene import ReferenceScene
from pa_console.language.references.trait_clauses import AssetClauses, GateClauses, sent

_OF = frozenset(("of", "among"))
_DEALT_WITH = frozenset(("warn", "identify", "stop", "block", "unknown", "check", "approaching"))
_MOST = 20
"""More things than these are not counted out in words."""


def find_descriptions(
    scene: ReferenceScene, tokens: Sequence[WordToken], text: str
) -> Iterator[Description]:
    """Yield the descriptions in `text`, whose words are `tokens`, from left to right."""
    at, of = 0, None
    while at < len(tokens):
        parser = _DescriptionParser(scene, tokens, text, at, of)
        found = parser.description()
        reader = parser.reader
        if found is not None and found.number == 0 and at and tokens[at - 1].word in _OF:
            of = found
            end = tokens[reader.at].end if reader.word() == "," else found.end
            yield replace(found, start=tokens[at - 1].start, end=end, partitive=True)
        elif found is not None:
            yield found
        at = reader.at if found is not None else at + 1


class _DescriptionParser:
    """Reads one description from one place of an order.

    `of` is said before it: of whom or what *the one* is one.
    """

    def __init__(
        self,
        scene: ReferenceScene,
        tokens: Sequence[WordToken],
        text: str,
        at: int,
        of: Description | None = None,
    ) -> None:
        self._scene, self._text, self._first, self._of = scene, text, at, of
        self.reader = Reader(tokens, at)
        self._told = PartialDescription(scene, self.reader)
        self._number = 1
        self._any = self._definite = False
        self._bare = False
        """True if there is no determiner."""
        self._vague = False
        """True if the noun is *one*, which may be a visitor as well as an asset."""

    def description(self) -> Description | None:
        """Return the description that begins here, None where none does."""
        reader, told = self.reader, self._told
        if not (self._possessive() or self._pronoun() or self._noun_phrase()):
            return None
        if not told.describes or (not self._definite and told.ranking is None):
            return None
        if self._idle_only and (self._number == 0 or self._bare):
            return None  # who is free is the planner's to choose
        if self._vague and any(track.gate == told.place for track in self._scene.visitors()):
            return None
        start, end = reader.tokens[self._first].start, reader.tokens[reader.at - 1].end
        return Description(
            start=start,
            end=end,
            said=self._text[start:end],
            sort=told.sort,
            traits=tuple(told.traits),
            ranking=told.ranking,
            number=self._number,
            any_will_do=self._any,
            place=told.place,
        )

    @property
    def _idle_only(self) -> bool:
        told = self._told
        said = [trait for trait in told.traits if trait in (is_idle, works)]
        team = len(told.traits) - len(said) <= 1
        return is_idle in said and team and told.ranking is None and not told.place

    # ------------------------------------------------------------------ heads

    def _possessive(self) -> bool:
        """Read *Drone_T01's gate*, *the same gate as Drone_T01*, *Drone_T01's old gate*."""
        reader, scene = self.reader, self._scene
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
            return False
        before = [move.before for move in scene.moved if move.agent == name and move.before]
        place = before[-1] if old and before else scene.place_of(name)
        self._told.sort, self._definite = "gate", True
        return self._told.say(lambda _, gate: gate == place)

    def _pronoun(self) -> bool:
        """Read *whoever is nearest*, *everyone but the guards*, *everybody at the checkpoint*."""
        reader, told = self.reader, self._told
        start = reader.at
        if reader.take_in(words.ANYBODY):
            if self._scene.members(reader.word()) or reader.word() in (*ASSETS, "gate"):
                reader.at = start
                return False
            self._any = self._definite = True
        elif reader.take_in(words.EVERYBODY) or (
            reader.word() == "all" and reader.word(1) in ("but", "except") and reader.take("all")
        ):
            self._number, self._definite = 0, True
            told.traits.append(works)
        else:
            return False
        self._after()
        led = reader.tokens[start - 1].word if start else "."
        if told.describes and not (self._number == 0 and told.bare_location and led[0].isalnum()):
            return True
        reader.at = start
        self._told = PartialDescription(self._scene, reader)
        return False

    def _noun_phrase(self) -> bool:
        """Read a determiner, adjectives, a noun and its clauses."""
        reader = self.reader
        start = reader.at
        self._determiner()
        while self._adjective():
            pass
        if not self._noun():
            reader.at = start
            return False
        self._after()
        return True

    def noun_traits(self) -> list[Trait]:
        """Read a noun phrase and return its traits; none if there is none here."""
        return self._told.traits if self._noun_phrase() else []

    def _determiner(self) -> None:
        reader = self.reader
        before = reader.word(-1)
        if reader.take("both of the", "both the", "both"):
            self._number, self._definite, self._told.describes = 2, True, True
        elif reader.take("all of the", "all the") or reader.take_in(words.EVERY):
            self._number, self._definite = 0, True
            self._count()
        elif reader.take_in(words.FREE_CHOICE):
            self._any = self._definite = True
        elif reader.take_in(words.DEFINITE):
            self._definite = True
            self._count()
        elif reader.word() in words.INDEFINITE:
            reader.at += 1
        else:
            self._definite = self._bare = not before or not before[0].isalnum()

    def _count(self) -> None:
        """Read how many are meant: *the two*, *all three*; *the one* is only the one."""
        number = number_of(self.reader.word())
        following = self.reader.word(1)
        if not 1 <= number <= _MOST or following in ("", ","):
            return
        if number > 1 or following not in words.AFTER_ONE:
            self.reader.at += 1
            self._number = number

    def _adjective(self) -> bool:
        """Read one adjective; False where none is here."""
        reader, told = self.reader, self._told
        if reader.word() in words.NEAR | words.FAR:
            told.rank(Superlative("near" if reader.take_in(words.NEAR) else "far"))
            reader.take_in(words.FAR)
        elif reader.take("freshest"):
            told.of_assets = told.rank(Superlative("full"))
        elif reader.take("other", "remaining"):
            self._other()
        elif reader.take_in(words.BARE):
            told.sort = "gate"
            told.say(is_bare)
        elif reader.word() in ("last", "first") and self._scene.moved:
            sent(told, early=reader.take("last", "first") == "first")
        elif self._definite and (number := number_of(reader.word())) > 1:
            reader.at += 1
            self._number = number
        else:
            return bool(reader.take("only", "single", "own", "very")) or self._state()
        return True

    def _state(self) -> bool:
        """Read an adjective of an asset's state."""
        reader, told = self.reader, self._told
        for state_words, trait in (
            (words.IDLE, is_idle),
            (("low", "flat"), is_low),
            (words.FAILED, has_failed),
            (words.SILENT, is_silent),
        ):
            if reader.take_in(state_words):
                told.of_assets = True
                return told.say(trait)
        return False

    def _noun(self) -> bool:
        reader, told = self.reader, self._told
        word = reader.word()
        if word in ("gate", "gates"):
            return self._gate(word)
        if told.sort == "gate":
            return bool(reader.take("one", "entrance"))
        if word == "one" and self._of is not None:
            reader.at += 1
            told.sort = self._of.sort
            told.traits += self._of.traits
            return True
        team = self._scene.members(word)
        single = word.removesuffix("s")
        if not team and single != "guard" and single not in (*ASSETS, "one"):
            return False
        if single == "vehicle" and self._means_contact():
            return False
        reader.at += 1
        self._vague = single == "one"
        if word.endswith("s") and self._number == 1:
            self._number = 0
        if team:
            told.traits.append(lambda _, name: name in team)
        elif single == "guard":
            told.traits.append(is_guard)
        return True

    def _gate(self, word: str) -> bool:
        """Read the noun *gate*; *that gate* may be the one to which something is coming."""
        reader, scene = self.reader, self._scene
        if self._told.of_assets:
            return False
        reader.at += 1
        self._told.sort = "gate"
        if word == "gates" and self._number == 1:
            self._number = 0
        if reader.word(-2) != "that":
            return True
        before = reader.tokens[: self._first]
        kinds = [words.CONTACTS[token.word] for token in before if token.word in words.CONTACTS]
        if kinds and scene.visitors(kinds[-1]):
            self._told.say(lambda s, g: any(t.gate == g for t in s.visitors(kinds[-1])))
        return True

    def _means_contact(self) -> bool:
        """Return whether the vehicle here comes to a gate: one is there, or is dealt with."""
        before = self.reader.word(-2) if self._definite else self.reader.word(-1)
        return before in _DEALT_WITH or bool(self._scene.visitors("vehicle"))

    def _other(self) -> None:
        """Leave out what the rest of the order names, or else what the last one was about.

        Where two gates were spoken of, the other one is of these two.
        """
        scene, last = self._scene, self._scene.last
        named = {token.said.lower() for token in self.reader.tokens}
        out = [n for n in (*scene.world.assets, *scene.gates) if n.lower() in named]
        if not any(name in scene.world.assets for name in out) and last is not None:
            out += [move.agent for move in last.moves]
        if not any(name in scene.gates for name in out) and last is not None:
            out += [move.target for move in last.moves if move.target]
            spoken = [n for n in scene.gates if n in last.text and n not in out]
            if len(spoken) == 1:
                self._told.say(lambda s, name: name in s.world.assets or name in spoken)
        self._told.say(lambda _, name: name not in out)

    # ------------------------------------------------------------------ after the noun

    def _after(self) -> None:
        """Read the clauses after the noun, as long as they are understood."""
        reader, told = self.reader, self._told
        told.from_where()
        assets = AssetClauses(told, self._other_noun)
        gates = GateClauses(told)
        while True:
            start, known = reader.at, (len(told.traits), told.ranking)
            if reader.word(1) in ("that", "which", "who"):
                reader.take(",")
            clauses = gates if told.sort == "gate" else assets
            said = clauses.read()
            if not said or ((len(told.traits), told.ranking) == known and not told.past):
                reader.at = start
                return

    def _other_noun(self) -> list[Trait]:
        """Read another noun phrase here and return its traits."""
        inner = _DescriptionParser(self._scene, self.reader.tokens, self._text, self.reader.at)
        traits = inner.noun_traits()
        self.reader.at = inner.reader.at
        return traits
