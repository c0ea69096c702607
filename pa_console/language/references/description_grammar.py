"""A grammar for definite descriptions: *the gate with only one guard*, *both robots*.

A description consists of a determiner, adjectives, a noun, and clauses about its place, guards,
state or distance. The grammar is written by hand and parses from left to right. An unknown word
ends a description; it is never skipped.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

from pa_console.language.mentions import ASSETS
from pa_console.language.references import reader as words
from pa_console.language.references.description import (
    DETERMINERS,
    OF,
    Description,
    Group,
    PartialDescription,
    ReadSet,
    SentenceGroups,
    Superlative,
    Trait,
    fitting,
    has_failed,
    is_bare,
    is_guard,
    is_idle,
    is_low,
    is_silent,
    works,
)
from pa_console.language.references.reader import Reader, WordToken, number_of, stands_alone
from pa_console.language.references.scene import ReferenceScene
from pa_console.language.references.trait_clauses import (
    AssetClauses,
    GateClauses,
    place_of_owner,
    sent,
)

_DEALT_WITH = frozenset(("warn", "identify", "stop", "block", "unknown", "check", "approaching"))
_MOST = 20
"""The largest number that is read as a count."""


def find_descriptions(
    scene: ReferenceScene,
    tokens: Sequence[WordToken],
    text: str,
    groups: SentenceGroups | None = None,
) -> Iterator[Description]:
    """Yield the descriptions in `text`, whose words are `tokens`, from left to right.

    The caller has to record the meaning of each description in `groups` before the next one is
    read.
    """
    groups = SentenceGroups(scene, tokens) if groups is None else groups
    at = 0
    while at < len(tokens):
        reader = Reader(tokens, at)
        if (
            groups.begins_clause(at)
            and reader.take(*OF)
            and (read_set := _set_at(groups, text, reader.at))
        ):
            groups.introduce(read_set, at)
            at = read_set.end
            continue
        parser = _DescriptionParser(groups, text, at)
        if (described := parser.description()) is not None:
            yield described
            at = parser.reader.at
        elif read_set := _set_at(groups, text, at):
            groups.introduce(read_set, at)
            at = read_set.end
        else:
            at = groups.read_name(at)


def _set_at(groups: SentenceGroups, text: str, at: int) -> ReadSet | None:
    """Read a set of names or a plural noun at token `at`; return None if there is none."""
    return groups.read_names(at) or _DescriptionParser(groups, text, at).plural()


class _DescriptionParser:
    """A parser for one description that begins at token `at`; `groups` has the sets before it."""

    def __init__(self, groups: SentenceGroups, text: str, at: int) -> None:
        self._scene, self._groups, self._text, self._first = groups.scene, groups, text, at
        self.reader = Reader(groups.tokens, at)
        self._partial = PartialDescription(
            self._scene, self.reader, put=self.reader.word(-1) in words.PUTTING
        )
        self._number = 1
        self._any = self._definite = False
        self._bare = False
        """True if the noun has no determiner."""
        self._vague = False
        """True if the noun is *one*, which may mean a contact as well as an asset."""
        self._nameless = False
        """True if the noun is *one* or is left out."""
        self._demonstrative = False
        """True if the determiner is *the*, *this* or *that*."""
        self._team: frozenset[str] = frozenset()
        """The assets of the kind or team that the noun names."""
        self._every = False
        """True if the determiner is *every*, *each of the* or similar."""
        self._ordinal = False
        """True for *the former* or *the second one*, after which no clauses are read."""
        self._other = False
        """True if the description excludes assets or gates that were picked or mentioned before."""
        self._group: Group | None = None
        """The set that the description picks from; None if it has a noun of its own."""

    def description(self) -> Description | None:
        """Return the description that begins here; None if there is none."""
        partial = self._partial
        ways = (self._possessive, self._pronoun, self._one_of_two, self._noun_phrase)
        if not any(way() for way in ways):
            return None
        if not partial.describes and not self._mentioned_before() and not self._one_at_each():
            return None
        if not self._definite and partial.ranking is None:
            return None
        if partial.only_idle and (self._number == 0 or self._bare):
            return None  # the planner chooses among the free assets
        if self._vague and any(track.gate == partial.place for track in self._scene.visitors()):
            return None
        return self._whole()

    def plural(self) -> ReadSet | None:
        """Return the set that begins here with a plural noun: *the two robots*, *our drones*."""
        reader, partial = self.reader, self._partial
        choice = any(token.word == "whichever" for token in reader.tokens) and bool(
            reader.take("a", "an", "any", "either")
        )
        both = reader.word() == "both"
        if not choice:
            reader.take(*DETERMINERS)
        number = number_of(reader.word())
        reader.at += number > 1
        self._number, self._definite = 2 if both else max(number, 0), True
        while self._adjective():
            pass
        if partial.ranking is not None or self._other or not self._noun():
            return None
        if reader.word(-1).endswith("s") == choice:
            return None
        if not choice:
            self._after()
        fit = fitting(self._scene, self._whole())
        if self._number not in (0, len(fit)) and partial.sort == "asset":
            fit = tuple(name for name in fit if works(self._scene, name)) or fit
        clear = self._number in (0, len(fit))
        return ReadSet(fit, partial.sort, reader.at, clear, choice) if len(fit) > 1 else None

    def _whole(self) -> Description:
        partial, tokens = self._partial, self.reader.tokens
        start, end = tokens[self._first].start, tokens[self.reader.at - 1].end
        return Description(
            start=start,
            end=end,
            words=self._text[start:end],
            sort=partial.sort,
            traits=tuple(partial.traits),
            ranking=partial.ranking,
            number=self._number,
            any_will_do=self._any,
            place=partial.place,
            group=self._group,
            selects=self._selects,
        )

    @property
    def _selects(self) -> bool:
        """True for a choice between earlier names: *Drone_T04 or Ugv_T02, whichever is nearer*."""
        reader = Reader(self.reader.tokens, self._first)
        after = reader.word(-1) in (",", "-", "–", "(") and reader.word() == "whichever"
        return after and self._group is not None and self._group.choice and not self._group.leading

    def _mentioned_before(self) -> bool:
        """Read *the drone* as the drone mentioned in the order, or else in the last two missions.

        Returns False if none was mentioned, so that any drone will do.
        """
        if not self._demonstrative or self._number != 1 or not self._team:
            return False
        if not stands_alone(self._scene, self.reader):
            return False  # the noun belongs to a longer one: *the aircraft carrier*
        about = self._groups.last_mentioned(self._team)
        return bool(about) and self._partial.say(lambda _, name: name in about)

    def _one_at_each(self) -> bool:
        """Return whether the words ask for one asset at each gate: *a robot at every gate*."""
        before = [token.word for token in self.reader.tokens[: self._first]][-3:]
        if not self._every or self._partial.sort != "gate" or len(before) < 3:
            return False
        article, team, _ = before
        return article in ("a", "an", "one", "1") and bool(self._scene.members(team))

    # ------------------------------------------------------------------ heads

    def _possessive(self) -> bool:
        """Read *Drone_T01's gate*, *the same gate as Drone_T01*, *Drone_T01's old gate*."""
        place = place_of_owner(self._scene, self.reader)
        if place is None:
            return False
        self._partial.sort, self._definite = "gate", True
        return self._partial.say(lambda _, gate: gate == place)

    def _pronoun(self) -> bool:
        """Read *whoever is nearest*, *everyone but the guards*, *everybody at the checkpoint*."""
        reader, partial = self.reader, self._partial
        start = reader.at
        if reader.take_in(words.ANYBODY):
            if self._scene.members(reader.word()) or reader.word() in (*ASSETS, "gate"):
                reader.at = start
                return False
            self._any = self._definite = True
            self._of_set()
        elif reader.take("whichever"):
            self._group = self._groups.open
            if not self._of_set() and (self._group is None or not self._group.mentioned):
                reader.at, self._group = start, None
                return False
            self._any = self._definite = True
        elif reader.take_in(words.EVERYBODY) or (
            reader.word() == "all" and reader.word(1) in ("but", "except") and reader.take("all")
        ):
            self._number, self._definite = 0, True
            partial.traits.append(works)
        else:
            return False
        self._after()
        led = reader.tokens[start - 1].word if start else "."
        if partial.describes and not (
            self._number == 0 and partial.bare_location and led[0].isalnum()
        ):
            return True
        reader.at = start
        self._partial, self._group = PartialDescription(self._scene, reader), None
        return False

    def _of_set(self) -> bool:
        """Read the set to pick from, *of the two robots*; return False if there is none."""
        start = self.reader.at
        if self.reader.take(*OF):
            read_set = _set_at(self._groups, self._text, self.reader.at)
            if read_set is not None:
                self._groups.introduce(read_set, start)
                self._group, self.reader.at = self._groups.current, read_set.end
                return True
        self.reader.at = start
        return False

    def _one_of_two(self) -> bool:
        """Read *one* before *the other*: any member of a set that the order has introduced."""
        reader, group = self.reader, self._groups.open
        if group is None or reader.word() != "one" or reader.word(-1) in words.DETERMINED:
            return False
        left = [token.word for token in reader.tokens[reader.at :]]
        if ("the", "other") not in pairwise(left) or not stands_alone(self._scene, reader, 1):
            return False
        reader.at += 1
        self._any = self._definite = True
        self._group = group
        return self._partial.say(lambda _, name: name not in group.picked)

    def _noun_phrase(self) -> bool:
        """Read a determiner, adjectives, a noun and its clauses."""
        reader = self.reader
        start = reader.at
        self._determiner()
        while self._adjective():
            pass
        if not (self._noun() or self._headless()):
            reader.at = start
            return False
        if self._other:
            self._leave_out()
        if not self._ordinal:
            self._after()
        return True

    def noun_traits(self) -> list[Trait]:
        """Read a noun phrase and return its traits; empty if there is no noun phrase."""
        return self._partial.traits if self._noun_phrase() else []

    def _determiner(self) -> None:
        reader = self.reader
        before = reader.word(-1)
        if reader.take("both of the", "both the", "both"):
            self._number, self._definite, self._partial.describes = 2, True, True
        elif reader.take(*words.EVERY_ONE) or reader.take_in(words.EVERY):
            self._number, self._definite, self._every = 0, True, True
            self._count()
        elif reader.take_in(words.FREE_CHOICE):
            self._any = self._definite = True
        elif determiner := reader.take_in(words.DEFINITE):
            self._definite = True
            self._demonstrative = determiner in ("the", "this", "that")
            self._count()
        elif reader.word() in words.INDEFINITE:
            reader.at += 1
        else:
            self._definite = self._bare = not before or not before[0].isalnum()

    def _count(self) -> None:
        """Read how many are meant: *the two*, *all three*; in *the one*, *one* is the noun."""
        number = number_of(self.reader.word())
        following = self.reader.word(1)
        if not 1 <= number <= _MOST or following in ("", ","):
            return
        if number > 1 or following not in words.AFTER_ONE:
            self.reader.at += 1
            self._number = number

    def _adjective(self) -> bool:
        """Read one adjective; return False if there is none."""
        reader, partial = self.reader, self._partial
        if reader.word() in words.NEAR | words.FAR:
            partial.rank(Superlative("near" if reader.take_in(words.NEAR) else "far"))
            reader.take_in(words.FAR)
        elif self._definite and reader.word() in words.FULLER | words.EMPTIER:
            fuller = bool(reader.take_in(words.FULLER)) or not reader.take_in(words.EMPTIER)
            partial.of_assets = partial.rank(Superlative("full" if fuller else "flat"))
        elif reader.take("other", "remaining"):
            self._other = partial.describes = True
        elif self._definite and (name := self._groups.in_order(reader.word())):
            reader.at += 1
            self._group, self._ordinal = self._groups.current, True
            partial.say(lambda _, candidate: candidate == name)
        elif reader.take_in(words.BARE):
            partial.sort = "gate"
            partial.say(is_bare)
        elif reader.word() in ("last", "first") and self._scene.moved:
            sent(partial, early=reader.take("last", "first") == "first")
        elif self._definite and (number := number_of(reader.word())) > 1:
            reader.at += 1
            self._number = number
        else:
            return bool(reader.take("only", "single", "own", "very", "same")) or self._state()
        return True

    def _state(self) -> bool:
        """Read an adjective of an asset's state."""
        reader, partial = self.reader, self._partial
        for state_words, trait in (
            (words.IDLE, is_idle),
            (("low", "flat"), is_low),
            (words.FAILED, has_failed),
            (words.SILENT, is_silent),
        ):
            if reader.take_in(state_words):
                partial.of_assets = True
                return partial.say(trait)
        return False

    def _noun(self) -> bool:
        reader, partial = self.reader, self._partial
        word = reader.word()
        if word in ("gate", "gates"):
            return self._gate(word)
        if partial.sort == "gate":
            return bool(reader.take("one", "entrance"))
        group = self._groups.open
        if word in ("one", "ones") and group is not None and not self._other:
            self._group = self._group or group
            if group.mentioned:
                reader.at += 1
                partial.sort = group.sort
                return True
        if self._definite and not self._other and reader.word() in ("others", "rest"):
            rest = self._groups.rest
            if rest is None or not rest.mentioned or self.reader.word(-2) in words.LEAVING:
                return False
            reader.at += 1
            self._number, self._other, partial.describes = 0, True, True
            return True
        team = self._scene.members(word)
        single = word.removesuffix("s")
        if not team and single != "guard" and single not in (*ASSETS, "one"):
            return False
        if single == "vehicle" and self._means_contact():
            return False
        reader.at += 1
        self._vague = self._nameless = single == "one"
        if word.endswith("s") and self._number == 1:
            self._number = 0
        self._team = team
        if team:
            partial.traits.append(lambda _, name: name in team)
        elif single == "guard":
            partial.traits.append(is_guard)
        return True

    def _gate(self, word: str) -> bool:
        """Read the noun *gate*; *that gate* may be the gate that a contact approaches."""
        reader, scene = self.reader, self._scene
        if self._partial.of_assets:
            return False
        reader.at += 1
        self._partial.sort = "gate"
        if word == "gates" and self._number == 1:
            self._number = 0
        if reader.word(-2) != "that":
            return True
        before = reader.tokens[: self._first]
        kinds = [words.CONTACTS[token.word] for token in before if token.word in words.CONTACTS]
        if kinds and scene.visitors(kinds[-1]):
            self._partial.say(lambda s, g: any(t.gate == g for t in s.visitors(kinds[-1])))
        return True

    def _means_contact(self) -> bool:
        """Return whether *vehicle* means a contact.

        It does after a word such as *warn*, or if a vehicle is in sight.
        """
        before = self.reader.word(-2) if self._definite else self.reader.word(-1)
        return before in _DEALT_WITH or bool(self._scene.visitors("vehicle"))

    def _headless(self) -> bool:
        """Read a phrase without a noun: *the other* goes north, *the nearer* of the two robots."""
        partial = self._partial
        if (
            not self._definite
            or self._bare
            or partial.sort == "gate"
            or not stands_alone(self._scene, self.reader)
        ):
            return False
        self._nameless = True
        if partial.ranking is not None and self._group is None:
            return self._of_set() or self._from_open()
        return self._group is not None or (self._other and bool(self._groups.latest))

    def _from_open(self) -> bool:
        """Pick from the set that the order has introduced; return False if there is none."""
        group = self._groups.open
        self._group = group if group is not None and group.mentioned else None
        return self._group is not None

    def _leave_out(self) -> None:
        """Add the trait of *the other*: not picked from its set, not named, not moved last.

        If the last order named exactly one other gate, *the other gate* is that gate.
        """
        partial, scene, last = self._partial, self._scene, self._scene.last
        rest = self._groups.rest
        if rest is not None and partial.fits_one_of(rest):
            self._group = rest
            partial.say(lambda _, name: name not in rest.picked)
            return
        pronoun = self._nameless and bool(self._groups.latest)
        tokens = self.reader.tokens[: self._first] if pronoun else self.reader.tokens
        named = {token.written.lower() for token in tokens}
        out = [n for n in (*scene.world.assets, *scene.gates) if n.lower() in named]
        out += self._groups.named
        if not any(name in scene.world.assets for name in out) and last is not None:
            out += [move.agent for move in last.moves]
        if not any(name in scene.gates for name in out) and last is not None:
            out += [move.target for move in last.moves if move.target]
            mentioned = [n for n in scene.gates if n in last.text and n not in out]
            if len(mentioned) == 1:
                partial.say(lambda s, name: name in s.world.assets or name in mentioned)
        kinds = {scene.world.assets[name].kind for name in self._groups.latest}
        if self._nameless and len(kinds) == 1:
            partial.say(lambda s, name: s.world.assets[name].kind in kinds)
        partial.say(lambda _, name: name not in out)

    # ------------------------------------------------------------------ after the noun

    def _after(self) -> None:
        """Read the clauses after the noun, up to the first that is not understood."""
        reader, partial = self.reader, self._partial
        partial.from_where()
        assets = AssetClauses(partial, self._other_noun)
        gates = GateClauses(partial)
        while True:
            start, before = reader.at, (len(partial.traits), partial.ranking)
            if reader.word(1) in ("that", "which", "who"):
                reader.take(",")
            clauses = gates if partial.sort == "gate" else assets
            understood = clauses.read()
            if not understood or (
                (len(partial.traits), partial.ranking) == before and not partial.past
            ):
                reader.at = start
                return

    def _other_noun(self) -> list[Trait]:
        """Read another noun phrase at the cursor and return its traits."""
        inner = _DescriptionParser(self._groups, self._text, self.reader.at)
        traits = inner.noun_traits()
        self.reader.at = inner.reader.at
        return traits
