"""Comparison of a reading with the words of its order: missing and added parts.

A model may misread an order, and the judge may make the same mistake. This check compares words
without a model. Every place, asset, track, kind, number and plain verb of the order must appear in
the reading, in the plan or in the list of unmet requests. Every place, asset, kind, number and task
of the reading must appear in the words of the order, or follow from these words and the picture.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

from pa_console.language.canonical.clauses import ASKED, NOTHING, NOWHERE, OTHERS_STAY
from pa_console.language.canonical.facts import is_free, sole_covers
from pa_console.language.canonical.order import (
    KIND_FOR,
    TASK_OF,
    Ask,
    Reading,
    Task,
    Who,
)
from pa_console.language.canonical.reading import read_asked
from pa_console.language.clock_words import unread_times
from pa_console.language.exclusions import excluded_names
from pa_console.language.lexicon import any_of
from pa_console.language.mentions import Mention, Sort, find_mentions, without_quotations
from pa_console.language.name_linking import WORD, link_names
from pa_console.language.orders.order_steps import unkept_steps
from pa_console.language.references.scene import ReferenceScene
from pa_console.schema.command import STILL
from pa_console.schema.plan import Plan
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import PLAIN_KINDS, AssetKind, World

_NAME = re.compile(r"[A-Za-z0-9_]+")
_CORRECTING = frozenset(
    (
        *("no", "nah", "na", "nope", "sorry", "correction", "wait", "actually", "scratch"),
        *("rather", "disregard", "belay"),
    )
)
_CORRECTS = re.compile(
    rf"\b(?:(?:{'|'.join(sorted(_CORRECTING))})\b\s*[,.:;!-]|scratch (?:that|it)|make (?:that|it)\b"
    r"|i (?:mean|meant)\b|never ?mind\b|(?:strike|belay|disregard) that\b)"
    r"(?!\s*(?:also|and|plus|then|as well)\b)",
    re.IGNORECASE,
)
"""Markers of a correction within an order; *actually, also* continues the order instead."""
_NAMED: frozenset[Sort] = frozenset(("place", "asset", "track"))


def _any_of(name: str) -> re.Pattern[str]:
    return re.compile(any_of("mention_check", name))


_KIND_WORDS: Mapping[AssetKind, re.Pattern[str]] = {
    kind: _any_of(f"of_{kind}") for kind in PLAIN_KINDS
}
"""Patterns of the words that mean a kind without naming it, for texts in lower case."""
_SOMEBODY = _any_of("somebody")
_BARE = _any_of("bare")
_LOW = _any_of("low")
_DOWN = _any_of("down")
_EVERY = _any_of("every")
_PAIR = _any_of("pair")
_GATES = _any_of("gates")
_EVERY_GATE = _any_of("every_gate")
"""The pattern of the words that mean every gate without naming one, for texts in lower case."""


class AccountedMention(NamedTuple):
    """A mention in the order, and whether the reading, plan or unmet lines account for it."""

    mention: Mention
    accounted: bool


class UnsupportedPart(NamedTuple):
    """A part of a reading that the order does not support, and its sort."""

    sort: Sort
    named: str


class MentionCheck(NamedTuple):
    """Every mention in an order, and the parts of its reading that go beyond these mentions."""

    mentions: tuple[AccountedMention, ...]
    unsupported: tuple[UnsupportedPart, ...] = ()
    moves: bool = False
    """True if the plan moves an asset."""
    unfounded: bool = False
    """True if the order names nothing, and its words support no place of the reading."""
    times: tuple[str, ...] = ()
    """The times in the order, if the plan moves an asset at once and so keeps none of them."""
    steps: tuple[str, ...] = ()
    """The steps of the order, if the plan was not made in steps and does not keep their
    sequence."""
    gates: tuple[str, ...] = ()
    """The words for several gates, if the reading sends assets to only one gate."""
    leaning: tuple[str, ...] = ()
    """The words that refer to the previous order, if their meaning was not found."""

    @property
    def baseless(self) -> bool:
        """True if an asset is moved although no word of the order supports this."""
        return self.moves and (self.empty or self.unfounded)

    @property
    def empty(self) -> bool:
        """True if the order names no place, no asset, no track and no task."""
        return all(part.mention.sort in ("kind", "number", "numeral") for part in self.mentions)

    @property
    def gaps(self) -> tuple[str, ...]:
        """The differences between order and reading, in words; empty if there are none."""
        gaps = [
            f"not accounted for: {part.mention.words}"
            for part in self.mentions
            if not part.accounted
        ]
        gaps += [f"not in the order's words: {part.named}" for part in self.unsupported]
        gaps += [f"time not kept: {words}" for words in self.times]
        gaps += [f"sequence of steps not kept: {words}" for words in self.steps]
        gaps += [f"only one gate served: {words}" for words in self.gates]
        if self.moves:
            gaps += [f"refers to an earlier order: {words}" for words in self.leaning]
        if self.empty and self.moves:
            gaps.append("no word of the order asks for anything")
        return tuple(dict.fromkeys(gaps))


NOTHING_SAID = MentionCheck(())
"""The result for a plan without a reading of the order."""


def check_mentions(  # noqa: PLR0917 - an order and the results of reading it
    world: World,
    picture: Picture,
    text: str,
    reading: str,
    plan: Plan,
    unmet: Sequence[str] = (),
    follows: str = "",
) -> MentionCheck:
    """Compare the words of an order with the planner's `reading`, in canonical words.

    Without a reading, the check looks only for missing parts, because a plan may do more than the
    order asks for. `unmet` are the lines about parts of the order that are not carried out. If the
    whole order is refused and no asset moves, nothing is missing. `follows` are the earlier
    commands that the order refers to; it need not name their assets and places again.
    """
    mentions = find_mentions(world, text, picture.tracks)
    moves = any(action.verb not in STILL for action in plan.actions)
    result = _OrderResult(world, picture, reading, plan, unmet)
    if result.refused and not moves:
        return MentionCheck(tuple(AccountedMention(mention, True) for mention in mentions))
    excluded = excluded_names(world, text)
    dropped = _dropped(excluded, link_names(world, text), mentions)
    needless = dropped.union(mention for mention in mentions if not mention.requested)
    listed = (
        AccountedMention(mention, mention in needless or result.accounts_for(mention))
        for mention in mentions
    )
    words = _OrderWords(world, picture, text, mentions, follows)
    unsupported = words.lacking(result) if reading else ()
    every_gate = _EVERY_GATE.search(text.lower()) if reading and result.goes_to_one_gate else None
    named = (name for ask in result.asks for name in ask.who.names)
    against = (UnsupportedPart("asset", name) for name in named if name in excluded)
    lacking = tuple(dict.fromkeys((*unsupported, *against)))
    names = follows or any(mention.sort in _NAMED for mention in mentions)
    unfounded = result.is_unfounded(lacking) and not names and not _GATES.search(text.lower())
    times = unread_times(world, text) if moves else ()
    steps = unkept_steps(ReferenceScene(world, picture), text) if moves else ()
    gates = (every_gate[0],) if every_gate is not None else ()
    return MentionCheck(tuple(listed), lacking, moves, unfounded, times, steps, gates=gates)


def _dropped(excluded: Collection[str], linked: str, mentions: Sequence[Mention]) -> set[Mention]:
    """Return the mentions that are `excluded` or replaced by a correction within the order.

    An excluded name is never used (`exclusions.py`), so no reading has to account for it. `linked`
    is the order with its names linked.
    """
    dropped = {mention for mention in mentions if mention.means in excluded}
    corrections = [match.start() for match in _CORRECTS.finditer(linked)]
    if corrections:
        before = [mention for mention in mentions if linked.rfind(mention.words) < corrections[-1]]
        after = {
            mention.sort for mention in mentions if linked.rfind(mention.words) > corrections[-1]
        }
        dropped.update(
            mention for mention in before if mention.sort in _NAMED and mention.sort in after
        )
        dropped.update(mention for mention in mentions if mention.words.lower() in _CORRECTING)
    return dropped


class _OrderResult:
    """The result of an order: the names and tasks in its reading, its plan and the unmet lines."""

    def __init__(
        self, world: World, picture: Picture, reading: str, plan: Plan, unmet: Sequence[str]
    ) -> None:
        self._world, self._picture = world, picture
        clauses, _, evidence = reading.partition("; now: ")
        self.asks = tuple(_asks(clauses)) if reading else ()
        under = re.match(r"asked: if ([^:]+):", clauses)
        self.subjects = _NAME.findall(under[1]) if under is not None else []
        """The names in the condition on which the action depends."""
        self.refused = bool(self.asks) and all(w.task == "refused" for w in self.asks)
        self._others_stay = OTHERS_STAY in clauses or OTHERS_STAY in evidence
        self._may_hold = self._others_stay or f"else: {NOTHING}" in clauses or not self.asks
        acting = [action for action in plan.actions if action.verb not in STILL]
        doing = acting if reading else plan.actions
        self._tasks: set[Task] = {ask.task for ask in self.asks}
        self._tasks |= {TASK_OF[action.verb] for action in doing}
        self._names = {*_NAME.findall(clauses), *(name for line in unmet for name in _words(line))}
        self._names.update(name for a in doing for name in (a.agent, a.target) if name)
        if self._tasks & {"home", "stand_down"}:
            self._names.add(world.base)
        self._assets = [name for name in world.assets if name in self._names]
        read_names = set(_NAME.findall(clauses)) if reading else self._names
        self._stood = {_at(picture, name) for name in self._assets if name in read_names}
        """The places of the assets that the reading names, because an order may describe an asset
        by its place: *the one at the north gate*."""
        self._acting = len({action.agent for action in acting})

    def is_unfounded(self, lacking: Sequence[UnsupportedPart]) -> bool:
        """Return whether the order supports no place of the reading.

        `lacking` are the parts that the order does not support. If the reading has no place, its
        assets are checked instead, and if it has no names, its tasks.
        """
        missing = {part.named for part in lacking}
        placed = [ask for ask in self.asks if ask.place not in ("", NOWHERE)]
        if placed:
            return all({ask.place, ask.leaving} & missing for ask in placed)
        names = {name for ask in self.asks for name in (*ask.who.names, ask.leaving) if name}
        names.update(PLAIN_KINDS[ask.who.kind] for ask in self.asks if ask.who.kind is not None)
        if not names:
            return any(part.sort == "verb" for part in lacking)
        return names <= missing

    @property
    def goes_to_one_gate(self) -> bool:
        """True if all assets that the reading sends to gates go to the same gate."""
        gates = [ask.place for ask in self.asks if ask.place in self._world.gates]
        return len(gates) == 1 and all(ask.task in ("go", "mass", "look") for ask in self.asks)

    def accounts_for(self, mention: Mention) -> bool:
        """Return whether this result accounts for a mention in the order."""
        match mention.sort:
            case "place":
                return mention.means in self._names or mention.means in self._stood
            case "asset":
                return mention.means in self._names or self._stands_for(mention.means)
            case "track":
                gate = self._picture.tracks[mention.means].gate
                return mention.means in self._names or gate in self._names
            case "kind":
                return self._has_kind(mention.means)
            case "number":
                return self._has_number(mention.means)
            case "numeral":
                return True
            case "verb":
                return self._has_task(mention.tasks)

    def _stands_for(self, name: str) -> bool:
        """Return whether `name` is meant but not named: it is one of *all*, or to be relieved."""
        place, spec = _at(self._picture, name), self._world.assets.get(name)
        if not self.asks and place in self._names:
            return True
        for ask in self.asks:
            left = ask.place or _at(self._picture, ask.leaving)
            if ask.task in ("cover", "relieve") and ask.leaving in ("", name) and left == place:
                return True
        every = (ask.who for ask in self.asks if ask.who.count == "all")
        return spec is not None and any(team.kind in (None, spec.kind) for team in every)

    def _has_kind(self, kind: str) -> bool:
        kinds: set[str | None] = {ask.who.kind for ask in self.asks}
        kinds |= {self._world.assets[name].kind for name in self._assets}
        kinds |= {KIND_FOR.get(task) for task in self._tasks}
        every = any(ask.who == Who(count="all") for ask in self.asks)
        return kind in kinds or every or not self.asks

    def _has_number(self, number: str) -> bool:
        teams = [ask.who for ask in self.asks]
        if self._others_stay or not teams:
            return True
        if number == "all":
            return any(team.count == "all" or len(team.names) > 1 for team in teams)
        counts = {len(team.names) or team.count for team in teams}
        return int(number) in counts | {len(teams), len(self._assets), self._acting}

    def _has_task(self, tasks: Collection[Task]) -> bool:
        if "hold" in tasks and self._may_hold:
            return True
        return bool(self._tasks & {*tasks, "refused"})


class _OrderWords:
    """The words of an order, which support parts of its reading."""

    def __init__(
        self,
        world: World,
        picture: Picture,
        text: str,
        mentions: Sequence[Mention],
        follows: str = "",
    ) -> None:
        self._world, self._picture = world, picture
        self._text = without_quotations(text).lower()
        before = _NAME.findall(follows)
        mentions = [mention for mention in mentions if not mention.quoted]
        self._names = {mention.means for mention in mentions if mention.sort in _NAMED}
        self._names.update(before)
        self._placed = any(mention.sort == "place" for mention in mentions)
        self._kinds = {mention.means for mention in mentions if mention.sort == "kind"}
        self._kinds |= {world.assets[name].kind for name in before if name in world.assets}
        self._numbers = {
            mention.means for mention in mentions if mention.sort in ("number", "numeral")
        }
        self._tasks = {task for mention in mentions for task in mention.supports}
        self._tasks |= {task for verb, task in TASK_OF.items() if verb in before}
        self._plain = any(
            mention.sort == "verb" and mention.requested and "hold" not in mention.tasks
            for mention in mentions
        )

    def lacking(self, result: _OrderResult) -> Iterator[UnsupportedPart]:
        """Yield the parts of `result` that these words do not support."""
        for name in result.subjects:
            guards = self._is_guard_of_a_bare_gate(name)
            if name in self._world.assets and not (guards or self._has_asset(name)):
                yield UnsupportedPart("asset", name)
            if name in self._world.frames and name not in self._names:
                yield UnsupportedPart("place", name)
        for ask in result.asks:
            if ask.task in ("refused", "unreadable"):
                continue
            if ask.place not in ("", NOWHERE) and not self._has_place(ask.place, ask):
                yield UnsupportedPart("place", ask.place)
            for name in filter(None, (*ask.who.names, ask.leaving)):
                left = name == ask.leaving and _at(self._picture, name) in self._names
                if not (left or self._has_asset(name) or self._is_described(name, ask.place)):
                    yield UnsupportedPart("asset", name)
            yield from self._team(ask.who)
            if not self._has_task(ask):
                yield UnsupportedPart("verb", ask.words)

    def _has_place(self, place: str, ask: Ask) -> bool:
        """Return True if `place` is named or, if no place is named, follows from the picture."""
        if place in self._names or (ask.leaving and _at(self._picture, ask.leaving) == place):
            return True
        tracks = [track for track in self._picture.tracks.values() if track.gate == place]
        if any(track.id in self._names for track in tracks):
            return True
        if self._placed:
            return False
        cover = self._picture.gates.get(place)
        bare = cover is not None and not cover.covered
        there = (name for name in self._picture.assets if _at(self._picture, name) == place)
        return (
            (bool(tracks) and _SOMEBODY.search(self._text) is not None)
            or (bare and _BARE.search(self._text) is not None)
            or any(self._has_fault(name) or name in self._names for name in there)
        )

    def _has_fault(self, name: str) -> bool:
        """Return whether the words mention a fault that the asset `name` has."""
        asset = self._picture.assets.get(name)
        if asset is None:
            return False
        low = asset.low_battery and _LOW.search(self._text) is not None
        return low or (not asset.available and _DOWN.search(self._text) is not None)

    def _has_asset(self, name: str) -> bool:
        """Return whether the words name or describe `name`, or give its number alone.

        *The drone* means the only drone of the world, or the only free drone.
        """
        digits = re.findall(r"\d+", name)
        numbered = bool(digits) and str(int(digits[-1])) in self._numbers
        return name in self._names or numbered or self._has_fault(name) or self._is_the_only(name)

    def _is_the_only(self, name: str) -> bool:
        """Return whether `name` is the only asset of its kind, or the only free one.

        The order has to mention the kind.
        """
        spec = self._world.assets.get(name)
        if spec is None or spec.kind not in self._kinds:
            return False
        team = self._of_kind(spec.kind)
        alone, assets = {*sole_covers(self._picture).values()}, self._picture.assets
        free = [other for other in team if other in assets and is_free(assets[other], alone)]
        return team == [name] or free == [name]

    def _is_guard_of_a_bare_gate(self, name: str) -> bool:
        """Return whether `name` is the only guard of the gate in *if West is uncovered*."""
        covers = sole_covers(self._picture).items()
        guards = any(guard == name and gate in self._names for gate, guard in covers)
        return guards and _BARE.search(self._text) is not None

    def _is_described(self, name: str, destination: str) -> bool:
        """Return whether a word for an asset, with its location, can mean only the asset `name`.

        A word such as *Steward* is enough if only one asset has that name. A destination does not
        describe an asset: *a drone to West* does not mean the drone that is at West.
        """
        spec = self._world.assets.get(name)
        if spec is None:
            return False
        name_words = _name_words(name) & {_singular(word) for word in _NAME.findall(self._text)}
        if name_words:
            team = [other for other in self._world.assets if name_words <= _name_words(other)]
        elif self._has_kind(spec.kind):
            team = self._of_kind(spec.kind)
        else:
            return False
        place = _at(self._picture, name)
        there = [other for other in team if _at(self._picture, other) == place]
        placed = place in self._names and place != destination and there == [name]
        return placed or (bool(name_words) and team == [name])

    def _team(self, team: Who) -> Iterator[UnsupportedPart]:
        if team.kind is not None and not self._has_kind(team.kind):
            yield UnsupportedPart("kind", PLAIN_KINDS[team.kind])
        if team.count == "all":
            if _EVERY.search(self._text) is None:
                yield UnsupportedPart("number", "all")
        elif team.count > 1 and not self._has_number(team.count):
            yield UnsupportedPart("number", str(team.count))

    def _has_number(self, number: int) -> bool:
        paired = number == 2 and _PAIR.search(self._text) is not None
        return paired or str(number) in self._numbers

    def _has_kind(self, kind: AssetKind) -> bool:
        """Return True if the order names the kind, by a word for the kind or for a team."""
        words = {_singular(word) for word in _NAME.findall(self._text)}
        if kind in self._kinds or words & self._teams(kind):
            return True
        if _KIND_WORDS[kind].search(self._text) is not None:
            return True
        return kind == "ugv" and not self._kinds and "vehicle" in self._text

    def _teams(self, kind: AssetKind) -> set[str]:
        """Return the words in the names of assets of `kind`."""
        return {word for name in self._of_kind(kind) for word in _name_words(name)}

    def _of_kind(self, kind: AssetKind) -> list[str]:
        return [name for name, spec in self._world.assets.items() if spec.kind == kind]

    def _has_task(self, ask: Ask) -> bool:
        """Return True if a word means the task, or if the task needs none, as in `van at east`."""
        if ask.task in self._tasks:
            return True
        if ask.task == "respond":
            visited = any(track.gate == ask.place for track in self._picture.tracks.values())
            return visited or _SOMEBODY.search(self._text) is not None
        if ask.task == "report" and "?" in self._text:
            return True
        if ask.task == "relieve" and {"go", "home"} <= self._tasks:
            return True
        somewhere = self._placed or ask.place == NOWHERE
        return ask.task in ("go", "mass", "home") and not self._plain and somewhere


def _asks(reading: str) -> Iterator[Ask]:
    """Yield the asks of a reading, in both cases of its condition."""
    words = reading.removeprefix(ASKED)
    case = re.fullmatch(r"if [^:]+: (.+?), else: (.+)", words)
    for part in (case[1], case[2]) if case is not None else (words,):
        clause = read_asked(f"{ASKED}{part}") or Reading(())
        yield from clause.asks


def _name_words(name: str) -> set[str]:
    """Return the words of an asset's name in lower case, without single letters."""
    words = (word.lower() for word in WORD.findall(name))
    return {word for word in words if len(word) > 1 and word.isalpha()}


def _words(line: str) -> list[str]:
    return _NAME.findall(line)


def _singular(word: str) -> str:
    return word[:-3] + "y" if word.endswith("ies") else word.removesuffix("s")


def _at(picture: Picture, name: str) -> str:
    """Return the post or place of an asset, or the place of a track; '' if there is none."""
    if name in picture.tracks:
        return picture.tracks[name].gate
    asset = picture.assets.get(name)
    return "" if asset is None else asset.post or asset.at or ""
