"""Resolves references in an order to names, before any model reads it.

*The gate with only one guard* becomes `EastGate`; in *bring it back*, *it* becomes the asset sent
last. References are never guessed: if several things fit the words, or none, a question is asked.
The result depends only on the words, the picture and the earlier missions.

A report of a state, *Drone_T03 is running on fumes*, becomes the order that is due, in the words of
the station's own alarms: a guard that failed or has a low battery is replaced, and any other asset
with a low battery returns home. A report that telemetry does not bear out is read as it stands.
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
    retell,
    substituted,
)
from pa_console.language.references.description import Description, SentenceGroups, Trait, fitting
from pa_console.language.references.description_grammar import find_descriptions
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


def reported_state(text: str) -> State | None:
    """Return the state of an asset that `text` reports; None for an order or a question.

    A vague request such as *sort it out* asks for nothing beyond what is due anyway.
    """
    low = " ".join(token.word for token in read_tokens(text))
    if _IF.search(low) or "?" in _VAGUE.sub("", low).replace("does not it ?", ""):
        return None
    bare = _VAGUE.sub(" ", low)
    state: State | None = next((one for one, pattern in _STATES if pattern.search(bare)), None)
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

    '' if nothing is due that the words do not ask for themselves.
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


MOST_CHOICES = 6
"""The most choices that a question lists; with more matches it lists none."""
_QUOTED = re.compile(r"\"[^\"]*\"|“[^”]*”")
"""Quoted words, which are not references."""
_STAYING = frozenset(("stay", "stays", "remain", "remains", "keep", "keeps"))
_THERE = frozenset(("there", "it"))
_NO_MOVE = frozenset(
    ("home", "base", "report", "reports", "back", "return", "returns", "hold", "stay", "doing")
)


Answers = Mapping[str, str]
"""The operator's answers about unclear words."""


def resolve(
    scene: ReferenceScene, text: str, answers: Answers | None = None
) -> ResolvedOrder | Unclear:
    """Return `text` with its references replaced by names, or the question to ask first."""
    answered = dict(answers or {})
    linked = LinkedText.of(scene.world, with_answers(text, answered))
    described = _described(scene, linked, reported_state(linked.text))
    if isinstance(described, Unclear):
        return described
    now, meant = described
    state = reported_state(now)
    meant = [*answered.items(), *meant]
    if state is not None and (due := _reported(scene, now, state)):
        return ResolvedOrder(due, (*meant, (text, due)))
    if order := conditional_order(scene, now):
        return ResolvedOrder(order, (*meant, (text, order)))
    retold = retell(scene, now)
    if isinstance(retold, Unclear):
        return retold
    if retold is not None:
        return replace(retold, meant=(*meant, *retold.meant))
    if (gate := _open_gate(scene, now)) is not None:
        return gate
    return ResolvedOrder(now.strip(), tuple(meant)) if meant else ResolvedOrder(text)


def _open_gate(scene: ReferenceScene, text: str) -> Unclear | None:
    """Return the question which gate *the gate* means, or None if one gate is the likeliest.

    That is the only gate with a track, or the only gate without a guard.
    """
    gates = scene.gates
    seen = {track.gate for track in scene.picture.tracks.values()} & {*gates}
    bare = [gate for gate in gates if not scene.guards(gate)]
    if len(gates) < 2 or len(seen) == 1 or len(bare) == 1 or scene.pointer in gates:
        return None
    tokens = read_tokens(text)
    if any(place_at(scene, Reader(tokens, at)) for at in range(len(tokens))):
        return None
    words = [token.word for token in tokens]
    for at, word in enumerate(words):
        if word == "gate" and at > 1 and words[at - 1] in _ANY_GATE and words[at - 2] in _TOWARDS:
            said = text[tokens[at - 1].start : tokens[at].end]
            choices = tuple(gates) if len(gates) <= MOST_CHOICES else ()
            return Unclear(said, "Which gate is meant?", choices)
    return None


_ANY_GATE = frozenset(("the", "a", "one", "some", "our", "my", "that", "this"))
_TOWARDS = frozenset(("to", "at", "over", "on", "towards", "toward", "near", "by", "outside"))


def with_answers(text: str, answers: Answers) -> str:
    """Return `text` with its unclear words replaced by the answers."""
    for said, means in answers.items():
        pattern = rf"(?<!\w){re.escape(said)}(?!\w)"
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
    found: list[Description] = []
    meant: list[ResolvedReference] = []
    quoted = [span.span() for span in _QUOTED.finditer(text)]
    for one in find_descriptions(scene, tokens, text, groups):
        one = replace(one, said=linked.said(one.start, one.end))  # noqa: PLW2901
        found.append(one)
        if any(start <= one.start < end for start, end in quoted):
            continue
        if _follows(tokens, one) in _STAYING and one.number != 1:
            continue
        if one.ranking is not None and one.ranking.distance and not one.ranking.place:
            place = _place_beside(scene, tokens, one)
            if not place:
                continue
            one = replace(one, ranking=replace(one.ranking, place=place))  # noqa: PLW2901
        names = _meant_by(scene, tokens, one, state)
        if isinstance(names, Unclear):
            return names
        if names:
            groups.mention(one, names)
            meant += _written(scene, tokens, one, names)
    meant += [
        ResolvedReference(group.start, group.end, "", "", " ")
        for group in groups.opened
        if group.leading and group.bound
    ]
    if not meant:
        return text, []
    return (
        _there_named(scene, substituted(text, meant), meant, found),
        [(each.said, each.means) for each in meant if each.said],
    )


def _follows(tokens: Sequence[WordToken], one: Description) -> str:
    return next((token.word for token in tokens if token.start >= one.end), "")


def _place_beside(scene: ReferenceScene, tokens: Sequence[WordToken], one: Description) -> str:
    """Return the place that goes with a superlative: *whoever is nearest goes to X*.

    It is the first place after the superlative, or else the last before it; '' if there is none.
    """
    before, after = "", ""
    at = 0
    while at < len(tokens):
        reader = Reader(tokens, at)
        place = place_at(scene, reader)
        if place and tokens[at].start >= one.end:
            after = after or place
        elif place and tokens[at].start < one.start:
            before = place
        at = max(at + 1, reader.at)
    return after or before


def _meant_by(
    scene: ReferenceScene, tokens: Sequence[WordToken], one: Description, state: State | None
) -> tuple[str, ...] | Unclear:
    """Return the names that a description means; none if the planner may choose."""
    asset, group = one.sort == "asset", one.group
    if group is not None and not group.clear:
        return _unclear(scene, one, group.members)
    ranked = one.ranking is not None and (group is None or not group.spoken)
    if asset and ranked and one.ranking is not None and one.ranking.distance:
        one = replace(one, traits=(*one.traits, _can_come(one.ranking.place)))
    names = fitting(scene, one)
    if asset:
        names = _likelier(scene, names, state)
    if apposed := _apposed(scene, tokens, one, names):
        return (apposed,)
    if one.number == 0 or one.number == len(names):
        return names if names else _unclear(scene, one, names)
    if names and (one.any_will_do or (one.ranking is not None and one.number == 1 and asset)):
        return names[:1] if one.any_will_do or len(names) == 1 else _unclear(scene, one, names)
    return _unclear(scene, one, names)


def _apposed(
    scene: ReferenceScene, tokens: Sequence[WordToken], one: Description, names: Sequence[str]
) -> str:
    """Return the name in apposition, as in *the other one, Robot_T02*; '' if there is none."""
    reader = Reader([token for token in tokens if token.start >= one.end])
    reader.take("i mean", "i meant", "that is", "namely")
    name = asset_at(scene, reader) if reader.take(",", ":", "(", "-") else ""
    return name if name in names and one.number == 1 else ""


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
    """Return the `names` in the reported state, or the available ones; all if none fit."""
    if state is not None:
        so = tuple(name for name in names if in_state(scene, name, state))
    else:
        so = tuple(name for name in names if scene.asset(name).available)
    return so or names


def _unclear(scene: ReferenceScene, one: Description, names: Sequence[str]) -> Unclear:
    what = "gate" if one.sort == "gate" else "asset"
    if not names:
        every = scene.gates if one.sort == "gate" else ()
        every = one.group.members if one.group is not None else every
        choices = tuple(every) if len(every) <= MOST_CHOICES else ()
        question = f"No {what} fits “{one.said}”. Which {what} is meant?"
        return Unclear(one.said, question, choices, describes=what == "asset")
    many = f"{len(names)} {what}s fit" if len(names) > 1 else f"Only {names[0]} fits"
    choices = tuple(names) if len(names) <= MOST_CHOICES else ()
    which = "Which one is meant?" if one.number == 1 else "Who is meant?"
    question = f"{many} “{one.said}”. {which}"
    return Unclear(one.said, question, choices, describes=what == "asset")


def _written(
    scene: ReferenceScene, tokens: Sequence[WordToken], one: Description, names: tuple[str, ...]
) -> list[ResolvedReference]:
    """Return the replacements for a description: its names, with a destination if it holds one.

    *Closest robot to the north gate, please* has its destination inside the description. The place
    of a failed asset is kept, because the prompt does not give it. With *whichever is nearer*, the
    name also replaces the alternatives before it.
    """
    if one.selects and one.group is not None:
        first = max(n for n, token in enumerate(tokens) if token.start < one.start)
        after = next((token for token in tokens if token.start >= one.end), None)
        enclosed = after is not None and after.word in (",", "-", "–", ")")
        end = after.end if after is not None and enclosed else one.end
        return [
            ResolvedReference(one.group.start, one.group.end, one.said, listed(names)),
            ResolvedReference(tokens[first].start, end, "", "", " " if enclosed else ""),
        ]
    means, becomes = listed(names), ""
    ranked = one.ranking is not None and one.ranking.distance and bool(one.place)
    if ranked and one.sort == "asset" and not _place_beside(scene, tokens, one):
        words = {t.word for t in tokens if not one.start <= t.start < one.end}
        if not words & (_NO_MOVE | _THERE):
            becomes = f"{means} to {one.place}"
    before = next((t.word for t in reversed(tokens) if t.end <= one.start), "")
    beside = before in ("with", "beside")
    down = len(names) == 1 and one.sort == "asset" and not scene.asset(names[0]).available
    if (beside or down) and one.sort == "asset" and one.place:
        becomes = f"{means} at {one.place}"
    return [ResolvedReference(one.start, one.end, one.said, means, becomes)]


def _there_named(
    scene: ReferenceScene,
    text: str,
    meant: Sequence[ResolvedReference],
    found: Sequence[Description],
) -> str:
    """Replace *there* by a place that only a description names."""
    inside = [one.place for one in found if one.place and one.sort == "asset" and one.ranking]
    gates = [one.means for one in meant if one.means in scene.gates]
    place = next(iter((*inside, *gates)), "")
    tokens = read_tokens(text)
    if not place:
        return text
    named = [t for t in tokens if t.said == place]
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
    """Return the order due for the asset that is reported in a state and is in it by telemetry.

    '' if none is named, or several are, or telemetry does not bear the report out: the words are
    then read as they stand. *One of the drones* is the one that telemetry shows in that state.
    """
    tokens = read_tokens(text)
    names = frozenset(token.said for token in tokens if token.said in scene.world.assets)
    if len(names) > 1:
        return ""
    teams = (scene.members(token.word) for token in tokens)
    names = names or next(filter(None, teams), frozenset[str]())
    so = [name for name in names if in_state(scene, name, state)]
    return what_is_due(scene, so[0], state) if len(so) == 1 else ""


def chosen(scene: ReferenceScene, answer: str, choices: Sequence[str]) -> str:
    """Return the one of `choices` that an answer means; '' if it fits none or several.

    An answer is a name, a part of one (*the south one*), a number or a kind.
    """
    if answer in choices:
        return answer
    gates = set(choices) <= set(scene.gates)
    answer = re.sub(r"\bone\b", "gate", answer) if gates else answer
    tokens = read_tokens(link_names(scene.world, answer))
    found: set[str] = set()
    at = 0
    while at < len(tokens):
        reader = Reader(tokens, at)
        name = asset_at(scene, reader) or place_at(scene, reader)
        if name in choices:
            found.add(name)
        elif len(whole := [choice for choice in choices if name and name in choice.split()]) == 1:
            found.update(whole)  # the choices are whole orders, each for another place
        at = max(at + 1, reader.at)
    if not found:
        orders = {token.said: [c for c in choices if token.said in c.split()] for token in tokens}
        found = {c[0] for said, c in orders.items() if said in scene.world.assets and len(c) == 1}
    if not found:
        for token in tokens:
            team = scene.members(token.word) & set(choices)
            digits = {n for n in choices if token.word.isdigit() and _number(n) == int(token.word)}
            found |= team or digits
    if not found:
        for one in find_descriptions(scene, tokens, answer):
            found |= set(fitting(scene, one)) & set(choices)
    return next(iter(found)) if len(found) == 1 else ""


def names_something(scene: ReferenceScene, answer: str) -> bool:
    """Return whether an answer names or describes a place or an asset."""
    tokens = read_tokens(link_names(scene.world, answer))
    readers = [Reader(tokens, at) for at in range(len(tokens))]
    if any(asset_at(scene, each) or place_at(scene, each) for each in readers):
        return True
    return any(fitting(scene, one) for one in find_descriptions(scene, tokens, answer))


def _number(name: str) -> int:
    digits = re.findall(r"\d+", name)
    return int(digits[-1]) if digits else -1
