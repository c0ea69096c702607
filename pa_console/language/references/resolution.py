"""The resolution of references in an order to names, before any model reads it.

*The gate with only one guard* becomes `EastGate`; in *bring it back*, *it* becomes the asset sent
last. References are never guessed: if several things fit the words, or none, a question is asked.
The result depends only on the words, the picture and the earlier missions.

A report of a state, *Drone_T03 is running on fumes*, becomes the order that is due, in the words of
the station's own alarms: a guard that failed or has a low battery is replaced, and any other asset
with a low battery returns home. A report that telemetry does not confirm is read as it stands.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

from pa_console.language.canonical.reading import listed
from pa_console.language.lexicon import find_verbs
from pa_console.language.name_linking import LinkedText, link_names
from pa_console.language.references.asked_condition import conditional_order
from pa_console.language.references.conversation import (
    ResolvedOrder,
    ResolvedReference,
    Unclear,
    substituted,
)
from pa_console.language.references.description import Description, SentenceGroups, Trait, fitting
from pa_console.language.references.description_grammar import find_descriptions
from pa_console.language.references.following_orders import retell
from pa_console.language.references.reader import Reader, WordToken, asset_at, place_at, read_tokens
from pa_console.language.references.scene import ReferenceScene

State = Literal["low", "failed", "silent"]
_ALMOST = r"(?:nearly|almost|about|close to|practically|all but|as good as)"
_CHARGE = r"(?:battery|batteries|charge|power|juice|cells?|energy|percent|pct|%)"
_LOW = (
    rf"{_ALMOST} (?:out|flat|empty|drained|dead|dry|used up)(?: of {_CHARGE})?",
    rf"low (?:on )?{_CHARGE}",
    rf"{_CHARGE} (?:is|are|looks|seems|gets|'s) (?:(?:very|too|rather|{_ALMOST}) )?"
    "(?:low|flat|empty|dying|drained|red|gone)",
    "running (?:on fumes|low|out)",
    rf"(?:not|hardly) (?:have )?(?:got )?much {_CHARGE}",
    rf"(?:down|drops?|dropped) to \w+ {_CHARGE}",
    "needs? (?:charging|a charge|to charge)",
    rf"out of {_CHARGE}",
    r"\d+ ?(?:%|percent)",
)
_SILENT = (
    "no (?:word|signal|telemetry|contact|reply|answer|news)",
    "lost (?:contact|the link|touch|signal)",
    "(?:gone|went) (?:quiet|silent|dark|off the net)",
    "not (?:answer|answering|respond|responding|replying|heard)",
    "(?:is|stays|has been) (?:silent|quiet|mute)",
    "off the net|stopped answering|unreachable",
)
_FAILED = (
    "died|dead|failed|failing|crashed|conked out|kaput|bust|quit|wrecked|stuck",
    "broken?(?: down)?|broke(?: down)?|packed (?:it )?in|fell (?:over|down|out)",
    "(?:gave|given) (?:up|out)|out of (?:order|action|service)|does not (?:move|get up)",
    "not working|stopped working|(?:is|went|gone) down|done for|had it|wrong with",
)
_STATES: tuple[tuple[State, re.Pattern[str]], ...] = (
    ("low", re.compile(rf"\b(?:{'|'.join(_LOW)})(?!\w)")),
    ("silent", re.compile(rf"\b(?:{'|'.join(_SILENT)})\b")),
    ("failed", re.compile(rf"\b(?:{'|'.join(_FAILED)})\b")),
)
_VAGUE = re.compile(
    r"\b(?:do something|sort (?:it|that|this|something)(?: out)?|see to it|take care|deal with it"
    r"|fix (?:it|that|this)|handle (?:it|this|that)|what now|act on it)\b"
)
_IF = re.compile(r"\b(?:if|when|unless|in case|once|should|until|before)\b")
_ORDER = frozenset(("send", "go", "move", "put", "bring", "get", "let", "have", "take", "swap"))

MOST_CHOICES = 6
"""The largest number of choices that a question lists; if there are more, it lists none."""
_QUOTED = re.compile(r"\"[^\"]*\"|“[^”]*”")
"""Quoted words, which are not references."""
_STAYING = frozenset(("stay", "stays", "remain", "remains", "keep", "keeps"))
_THERE = frozenset(("there", "it"))
_NO_MOVE = frozenset(
    ("home", "base", "report", "reports", "back", "return", "returns", "hold", "stay", "doing")
)

Answers = Mapping[str, str]
"""The operator's answers, by the unclear words that they are about."""

_ANY_GATE = frozenset(("the", "a", "one", "some", "our", "my", "that", "this"))
_TOWARDS = frozenset(("to", "at", "over", "on", "towards", "toward", "near", "by", "outside"))


def reported_state(text: str) -> State | None:
    """Return the state of an asset that `text` reports; None for an order or a question.

    A vague request such as *sort it out* does not turn a report into an order.
    """
    low = " ".join(token.word for token in read_tokens(text))
    if _IF.search(low) or "?" in _VAGUE.sub("", low).replace("does not it ?", ""):
        return None
    bare = _VAGUE.sub(" ", low)
    state: State | None = next((name for name, pattern in _STATES if pattern.search(bare)), None)
    if state is None:
        return None
    left = bare
    for _, pattern in _STATES:
        left = pattern.sub(" ", left)
    if _ORDER & set(left.split()):
        return None
    return None if any(verb.plain for verb in find_verbs(left)) else state


def in_state(scene: ReferenceScene, name: str, state: State) -> bool:
    """Return whether telemetry shows an asset in `state`; a failed asset is in every state."""
    asset = scene.asset(name)
    if asset.status == "failed":
        return True
    if state == "low":
        return asset.low_battery
    if state == "failed":
        return not asset.available
    return asset.comms == "lost" or asset.stale or asset.integrity == "suspect"


def what_is_due(scene: ReferenceScene, name: str, state: State) -> str:
    """Return the order due for the asset `name`, which is reported and known to be in `state`.

    Returns '' if nothing is due, or nothing beyond what the words already ask for.
    """
    gate = scene.guarded_by(name)
    alone = bool(gate) and all(guard == name for guard in scene.guards(gate))
    if scene.asset(name).status == "failed":
        return f"{name} has failed: fill the gap at {gate}." if alone else ""
    if state == "low":
        if alone:
            return f"Relieve {name} at {gate}."
        return f"{name} has a low battery and must return to base."
    if alone and state == "silent":
        return f"{name} is silent, so {gate} needs a second guard: send one asset to {gate}."
    return ""


def resolve(
    scene: ReferenceScene, text: str, answers: Answers | None = None
) -> ResolvedOrder | Unclear:
    """Return `text` with its references replaced by names, or the question to ask first."""
    answered = dict(answers or {})
    linked = LinkedText.of(scene.world, with_answers(text, answered))
    described = _described(scene, linked, reported_state(linked.text))
    if isinstance(described, Unclear):
        return described
    now, meanings = described
    state = reported_state(now)
    meanings = [*answered.items(), *meanings]
    if state is not None and (due := _reported(scene, now, state)):
        return ResolvedOrder(due, (*meanings, (text, due)))
    if order := conditional_order(scene, now):
        return ResolvedOrder(order, (*meanings, (text, order)))
    retold = retell(scene, now)
    if isinstance(retold, Unclear):
        return retold
    if retold is not None:
        return replace(retold, meanings=(*meanings, *retold.meanings))
    if (gate := _open_gate(scene, now)) is not None:
        return gate
    return ResolvedOrder(now.strip(), tuple(meanings)) if meanings else ResolvedOrder(text)


def _open_gate(scene: ReferenceScene, text: str) -> Unclear | None:
    """Ask which gate *the gate* means; return None if the question is not needed.

    It is not needed if a gate is marked, or if only one gate has a track or is without a guard.
    """
    gates = scene.gates
    seen = {track.gate for track in scene.picture.tracks.values()} & {*gates}
    bare = [gate for gate in gates if not scene.guards(gate)]
    if len(gates) < 2 or len(seen) == 1 or len(bare) == 1 or scene.pointer in gates:
        return None
    tokens = read_tokens(text)
    if any(place_at(scene, Reader(tokens, at)) for at in range(len(tokens))):
        return None
    token_words = [token.word for token in tokens]
    for at, word in enumerate(token_words):
        if (
            word == "gate"
            and at > 1
            and token_words[at - 1] in _ANY_GATE
            and token_words[at - 2] in _TOWARDS
        ):
            words = text[tokens[at - 1].start : tokens[at].end]
            choices = tuple(gates) if len(gates) <= MOST_CHOICES else ()
            return Unclear(words, "Which gate is meant?", choices)
    return None


def with_answers(text: str, answers: Answers) -> str:
    """Return `text` with its unclear words replaced by the answers."""
    for words, means in answers.items():
        pattern = rf"(?<!\w){re.escape(words)}(?!\w)"
        text = re.sub(pattern, lambda _, means=means: means, text, count=1, flags=re.IGNORECASE)
    return text


# ------------------------------------------------------------------- descriptions


def _described(
    scene: ReferenceScene, linked: LinkedText, state: State | None
) -> tuple[str, list[tuple[str, str]]] | Unclear:
    """Return the text with names for its descriptions, and each description with its meaning."""
    text = linked.text
    tokens = read_tokens(text)
    groups = SentenceGroups(scene, tokens)
    phrases: list[Description] = []
    references: list[ResolvedReference] = []
    quoted = [span.span() for span in _QUOTED.finditer(text)]
    for match in find_descriptions(scene, tokens, text, groups):
        phrase = replace(match, words=linked.original_words(match.start, match.end))
        phrases.append(phrase)
        if any(start <= phrase.start < end for start, end in quoted):
            continue
        if _follows(tokens, phrase) in _STAYING and phrase.number != 1:
            continue
        if phrase.ranking is not None and phrase.ranking.distance and not phrase.ranking.place:
            place = _place_beside(scene, tokens, phrase)
            if not place:
                continue
            phrase = replace(phrase, ranking=replace(phrase.ranking, place=place))
        names = _meant_by(scene, tokens, phrase, state)
        if isinstance(names, Unclear):
            return names
        if names:
            groups.mention(phrase, names)
            references += _written(scene, tokens, phrase, names)
    references += [
        ResolvedReference(group.start, group.end, "", "", " ")
        for group in groups.opened
        if group.leading and group.bound
    ]
    if not references:
        return text, []
    return (
        _there_named(scene, substituted(text, references), references, phrases),
        [(reference.words, reference.means) for reference in references if reference.words],
    )


def _follows(tokens: Sequence[WordToken], phrase: Description) -> str:
    return next((token.word for token in tokens if token.start >= phrase.end), "")


def _place_beside(scene: ReferenceScene, tokens: Sequence[WordToken], phrase: Description) -> str:
    """Return the place that goes with a superlative: *whoever is nearest goes to X*.

    It is the first place after the superlative, or else the last place before it; '' if there is
    none.
    """
    before, after = "", ""
    at = 0
    while at < len(tokens):
        reader = Reader(tokens, at)
        place = place_at(scene, reader)
        if place and tokens[at].start >= phrase.end:
            after = after or place
        elif place and tokens[at].start < phrase.start:
            before = place
        at = max(at + 1, reader.at)
    return after or before


def _meant_by(
    scene: ReferenceScene, tokens: Sequence[WordToken], phrase: Description, state: State | None
) -> tuple[str, ...] | Unclear:
    """Return the names that a description means; empty if the planner may choose."""
    asset, group = phrase.sort == "asset", phrase.group
    if group is not None and not group.clear:
        return _unclear(scene, phrase, group.members)
    ranked = phrase.ranking is not None and (group is None or not group.mentioned)
    if asset and ranked and phrase.ranking is not None and phrase.ranking.distance:
        phrase = replace(phrase, traits=(*phrase.traits, _can_come(phrase.ranking.place)))
    names = fitting(scene, phrase)
    if asset:
        names = _likelier(scene, names, state)
    if apposed := _apposed(scene, tokens, phrase, names):
        return (apposed,)
    if phrase.number == 0 or phrase.number == len(names):
        return names if names else _unclear(scene, phrase, names)
    if names and (
        phrase.any_will_do or (phrase.ranking is not None and phrase.number == 1 and asset)
    ):
        return (
            names[:1] if phrase.any_will_do or len(names) == 1 else _unclear(scene, phrase, names)
        )
    return _unclear(scene, phrase, names)


def _apposed(
    scene: ReferenceScene, tokens: Sequence[WordToken], phrase: Description, names: Sequence[str]
) -> str:
    """Return the name in apposition, as in *the other one, Robot_T02*; '' if there is none."""
    reader = Reader([token for token in tokens if token.start >= phrase.end])
    reader.take("i mean", "i meant", "that is", "namely")
    name = asset_at(scene, reader) if reader.take(",", ":", "(", "-") else ""
    return name if name in names and phrase.number == 1 else ""


def _can_come(place: str) -> Trait:
    """Return the trait of assets that can go to `place`: available, free and not already there."""
    return lambda scene, name: (
        scene.asset(name).available
        and (scene.is_free(name) or scene.place_of(name) == scene.world.base)
        and name != place
        and (scene.place_of(name) != place or place not in scene.gates)
    )


def _likelier(
    scene: ReferenceScene, names: tuple[str, ...], state: State | None
) -> tuple[str, ...]:
    """Return the `names` in the reported state, or the available ones; all names if none fit."""
    if state is not None:
        fitting_names = tuple(name for name in names if in_state(scene, name, state))
    else:
        fitting_names = tuple(name for name in names if scene.asset(name).available)
    return fitting_names or names


def _unclear(scene: ReferenceScene, phrase: Description, names: Sequence[str]) -> Unclear:
    noun = "gate" if phrase.sort == "gate" else "asset"
    if not names:
        every = scene.gates if phrase.sort == "gate" else ()
        every = phrase.group.members if phrase.group is not None else every
        choices = tuple(every) if len(every) <= MOST_CHOICES else ()
        question = f"No {noun} fits “{phrase.words}”. Which {noun} is meant?"
        return Unclear(phrase.words, question, choices, describes=noun == "asset")
    many = f"{len(names)} {noun}s fit" if len(names) > 1 else f"Only {names[0]} fits"
    choices = tuple(names) if len(names) <= MOST_CHOICES else ()
    request = "Which one is meant?" if phrase.number == 1 else "Which ones are meant?"
    question = f"{many} “{phrase.words}”. {request}"
    return Unclear(phrase.words, question, choices, describes=noun == "asset")


def _written(
    scene: ReferenceScene, tokens: Sequence[WordToken], phrase: Description, names: tuple[str, ...]
) -> list[ResolvedReference]:
    """Return the replacements for a description: its names, with a destination if it has one.

    *Closest robot to the north gate, please* has its destination inside the description. The place
    of a failed asset is kept, because the prompt does not give it. With *whichever is nearer*, the
    name also replaces the alternatives before it.
    """
    if phrase.selects and phrase.group is not None:
        first = max(n for n, token in enumerate(tokens) if token.start < phrase.start)
        after = next((token for token in tokens if token.start >= phrase.end), None)
        enclosed = after is not None and after.word in (",", "-", "–", ")")
        end = after.end if after is not None and enclosed else phrase.end
        return [
            ResolvedReference(phrase.group.start, phrase.group.end, phrase.words, listed(names)),
            ResolvedReference(tokens[first].start, end, "", "", " " if enclosed else ""),
        ]
    means, becomes = listed(names), ""
    ranked = phrase.ranking is not None and phrase.ranking.distance and bool(phrase.place)
    if ranked and phrase.sort == "asset" and not _place_beside(scene, tokens, phrase):
        words = {t.word for t in tokens if not phrase.start <= t.start < phrase.end}
        if not words & (_NO_MOVE | _THERE):
            becomes = f"{means} to {phrase.place}"
    before = next((t.word for t in reversed(tokens) if t.end <= phrase.start), "")
    beside = before in ("with", "beside")
    down = len(names) == 1 and phrase.sort == "asset" and not scene.asset(names[0]).available
    if (beside or down) and phrase.sort == "asset" and phrase.place:
        becomes = f"{means} at {phrase.place}"
    return [ResolvedReference(phrase.start, phrase.end, phrase.words, means, becomes)]


def _there_named(
    scene: ReferenceScene,
    text: str,
    references: Sequence[ResolvedReference],
    descriptions: Sequence[Description],
) -> str:
    """Replace *there* by a place that is named only in a description."""
    inside = [
        item.place for item in descriptions if item.place and item.sort == "asset" and item.ranking
    ]
    gates = [item.means for item in references if item.means in scene.gates]
    place = next(iter((*inside, *gates)), "")
    tokens = read_tokens(text)
    if not place:
        return text
    named = [t for t in tokens if t.written == place]
    for number, token in enumerate(tokens):
        if token.word not in _THERE or (named and named[0].start > token.start):
            continue
        before = tokens[number - 1].word if number else ""
        if token.word == "it" and before not in ("to", "at", "over"):
            continue
        start = tokens[number - 1].start if before == "over" and token.word == "there" else None
        head = text[: token.start if start is None else start]
        joint = "" if before in ("to", "at") else "to "
        return f"{head}{joint}{place}{text[token.end :]}"
    return text


# ------------------------------------------------------------------- states and answers


def _reported(scene: ReferenceScene, text: str, state: State) -> str:
    """Return the order due for an asset whose reported state telemetry confirms.

    Returns '' if no asset or several assets are named, or if telemetry does not confirm the report.
    The words are then read as they stand. *One of the drones* means the only drone in that state.
    """
    tokens = read_tokens(text)
    names = frozenset(token.written for token in tokens if token.written in scene.world.assets)
    if len(names) > 1:
        return ""
    teams = (scene.members(token.word) for token in tokens)
    names = names or next(filter(None, teams), frozenset[str]())
    matches = [name for name in names if in_state(scene, name, state)]
    return what_is_due(scene, matches[0], state) if len(matches) == 1 else ""


def chosen(scene: ReferenceScene, answer: str, choices: Sequence[str]) -> str:
    """Return the one of `choices` that an answer means; '' if it fits none or several.

    An answer is a name, a part of a name (*the south one*), a number or a kind.
    """
    if answer in choices:
        return answer
    gates = set(choices) <= set(scene.gates)
    answer = re.sub(r"\bone\b", "gate", answer) if gates else answer
    tokens = read_tokens(link_names(scene.world, answer))
    matches: set[str] = set()
    at = 0
    while at < len(tokens):
        reader = Reader(tokens, at)
        name = asset_at(scene, reader) or place_at(scene, reader)
        if name in choices:
            matches.add(name)
        elif len(whole := [choice for choice in choices if name and name in choice.split()]) == 1:
            matches.update(whole)  # the choices are whole orders, each for another place
        at = max(at + 1, reader.at)
    if not matches:
        orders = {
            token.written: [c for c in choices if token.written in c.split()] for token in tokens
        }
        matches = {c[0] for word, c in orders.items() if word in scene.world.assets and len(c) == 1}
    if not matches:
        for token in tokens:
            team = scene.members(token.word) & set(choices)
            digits = {n for n in choices if token.word.isdigit() and _number(n) == int(token.word)}
            matches |= team or digits
    if not matches:
        for description in find_descriptions(scene, tokens, answer):
            matches |= set(fitting(scene, description)) & set(choices)
    return next(iter(matches)) if len(matches) == 1 else ""


def names_something(scene: ReferenceScene, answer: str) -> bool:
    """Return whether an answer names or describes a place or an asset."""
    tokens = read_tokens(link_names(scene.world, answer))
    readers = [Reader(tokens, at) for at in range(len(tokens))]
    if any(asset_at(scene, reader) or place_at(scene, reader) for reader in readers):
        return True
    return any(
        fitting(scene, description) for description in find_descriptions(scene, tokens, answer)
    )


def _number(name: str) -> int:
    digits = re.findall(r"\d+", name)
    return int(digits[-1]) if digits else -1
