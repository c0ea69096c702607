"""The asks of an operator's order, and the condition that the order may have.

A `Reading` is a model's understanding of an order's words, and consists of asks. Its names may be
wrong, because an order can mention things that do not exist. A `Condition` can be written in
canonical words and in plain words; only facts decide whether it is true (`facts.py`).

An `Obstacle` is the reason why an ask cannot be carried out. The console looks for obstacles to
readings, the teacher for obstacles to generated orders. This module does not decide whether a gate
can spare its guard.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from pydantic import Field

from pa_console.language.canonical.word_form import WordForm
from pa_console.schema.base import StrictModel
from pa_console.schema.command import ADDRESSING, COMMANDS, STILL, Verb
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import KINDS, PLAIN_KINDS, AssetKind, World

Fact = Literal[
    "track_at",
    "no_track_at",
    "authorized",
    "unauthorized",
    "hostile",
    "uncovered",
    "covered",
    "low",
    "not_low",
    "down",
    "up",
    "free",
    "none_free",
]
"""A fact of the picture on which an order may depend."""
TrackKind = Literal["vehicle", "person", ""]

Task = Literal[
    "go",  # who moves to place
    "look",  # who (drones) observes place
    "identify",  # who (robots) identifies the contact at place
    "warn",  # who (robots) warns the contact at place
    "block",  # who (vehicles) blocks the lane at place
    "respond",  # an unknown contact is at place: take the next step; no asset is named
    "cover",  # place has no guard, or loses its own (`leaving`): an asset goes there
    "relieve",  # who takes over place from `leaving`, which goes home
    "swap",  # the two named assets change places
    "home",  # who returns to the base
    "stand_down",  # place is settled: its reinforcements go home
    "mass",  # every free asset (of a kind) goes to place
    "report",  # who reports; a question
    "hold",  # who stays where it is; no other command is given
    "refused",  # only read: what no order may have, for the reason in `wrong`
    "unreadable",  # only read: words that are not canonical
]
"""The tasks that an order can ask for."""
TASK_OF: Mapping[Verb, Task] = {
    "hold": "hold", "move_to": "go", "observe": "look", "identify": "identify", "warn": "warn",
    "block": "block", "return_to_base": "home", "report": "report",
}  # fmt: skip
"""The task that each command carries out."""
Wrong = Literal[
    "force",  # shoot, ram, run over (ROE-01)
    "skip_identification",  # warn or block at once, explicitly without finding out who (ROE-02)
    "skip_warning",  # block at once, explicitly without a warning (ROE-03)
    "override",  # set a rule aside (ROE-05)
    "chase",  # follow beyond the perimeter (ROE-06)
    "zone",  # enter a restricted zone (ROE-07)
    "noncombatants",  # identify, warn or block noncombatants, who are only watched (ROE-08)
    "strip",  # leave a gate without guard (WF-03)
    "unknown_place",  # a place that is no frame (CAP-06)
    "unknown_asset",  # an asset that does not exist
    "down",  # a named asset that is down
    "incapable",  # a kind that cannot do it: a drone warns, a robot flies (CAP-01..03)
    "none_left",  # a kind of which none is free
]
"""The reasons why an ask cannot be carried out as meant."""

VERB_FOR: Mapping[Task, Verb] = {
    TASK_OF[verb]: verb for verb, spec in COMMANDS.items() if len(spec.kinds) < len(KINDS)
}
"""The command for a task, if only some kinds of assets have that command."""
KIND_FOR: Mapping[Task, AssetKind] = {
    task: kind for task, verb in VERB_FOR.items() for kind in COMMANDS[verb].kinds
}
"""The kind of assets that a task requires."""
PLACED: frozenset[Task] = frozenset(
    ("mass", *(task for verb, task in TASK_OF.items() if COMMANDS[verb].takes_frame))
)
"""The tasks that need a place."""
STILL_TASKS: frozenset[Task] = frozenset(TASK_OF[verb] for verb in STILL)
"""The tasks that move no asset."""
MOVING_TASKS: frozenset[Task] = frozenset(TASK_OF.values()) - STILL_TASKS
"""The tasks of single commands that may move an asset."""
ADDRESSING_TASKS: frozenset[Task] = frozenset(TASK_OF[verb] for verb in ADDRESSING)
"""The tasks that require a contact at the place."""


class Condition(StrictModel):
    """The condition under which an order applies."""

    fact: Fact
    subject: str = Field(default="", description="a gate for tracks and cover, otherwise an asset")
    track: TrackKind = ""
    kind: AssetKind | None = Field(default=None, description="the kind that is free or not")


class ConditionForm(NamedTuple):
    """The form of a condition after *if*, in canonical words and in plain words for people."""

    words: WordForm
    plain: WordForm


def _form(words: str, plain: str) -> ConditionForm:
    return ConditionForm(WordForm(words), WordForm(plain))


def _identity_form(fact: Fact) -> ConditionForm:
    """Return the form of a condition about the known identity of a contact."""
    return _form(
        f"({{track}}|track) at {{subject}} {fact}",
        f"(the {{track}} at {{subject}}|what is at {{subject}}) is {fact}",
    )


CONDITIONS: Mapping[Fact, ConditionForm] = {
    "track_at": _form("({track}|track) at {subject}", "(a {track}|something) is at {subject}"),
    "no_track_at": _form("no ({track}|track) at {subject}", "(no {track}|nothing) is at {subject}"),
    "authorized": _identity_form("authorized"),
    "unauthorized": _identity_form("unauthorized"),
    "hostile": _identity_form("hostile"),
    "uncovered": _form("{subject} uncovered", "{subject} has no guard"),
    "covered": _form("{subject} covered", "{subject} has a guard"),
    "low": _form("{subject} low", "{subject} is low on battery"),
    "not_low": _form("{subject} not low", "{subject} is not low on battery"),
    "down": _form("{subject} down", "{subject} is out of order"),
    "up": _form("{subject} up", "{subject} is in order"),
    "free": _form("({kind}|asset) free", "(a {kind}|an asset) is free"),
    "none_free": _form("no ({kind}|asset) free", "no ({kind}|asset) is free"),
}


def in_words(condition: Condition) -> str:
    """Return the condition in the words that follow *if* in a reason."""
    return CONDITIONS[condition.fact].words.write(condition_slots(condition, PLAIN_KINDS))


def condition_slots(condition: Condition, kinds: Mapping[AssetKind, str]) -> dict[str, str]:
    """Return the slots of the form of `condition`; `kinds` has the words for kinds of assets."""
    slots = {"subject": condition.subject}
    if condition.track:
        slots["track"] = condition.track
    if condition.kind is not None:
        slots["kind"] = kinds[condition.kind]
    return slots


@dataclass(frozen=True, slots=True)
class Who:
    """The assets for a task: named assets, a number of assets of a kind, or any asset."""

    names: tuple[str, ...] = ()
    kind: AssetKind | None = None
    count: int | Literal["all"] = 1
    origin: str = ""
    """The frame from which the assets come; '' if it may be any frame."""


ANYBODY = Who()


@dataclass(frozen=True, slots=True)
class Ask:
    """One task of an order; `wrong` is the reason why it must not or cannot be done."""

    task: Task
    who: Who = ANYBODY
    place: str = ""
    """A frame, a zone, or a place that does not exist."""
    leaving: str = ""
    """The asset that leaves `place`, or has failed there."""
    track: Literal["vehicle", "person", ""] = ""
    track_id: str = ""
    """The station's id of the track, if the order names it."""
    wrong: Wrong | None = None
    strict_who: bool = False
    """True if no other assets may do the task; canonical words cannot express this."""
    words: str = ""
    """The clause from which the ask was read."""


class Reading(NamedTuple):
    """The asks of an order that apply now; of a conditional order, those of the case that is true.

    Parts that are not allowed in an order are read, but never carried out.
    """

    asks: tuple[Ask, ...]
    others_stay: bool = False
    excluded: tuple[str, ...] = ()
    """The assets and places that the order rules out."""

    @property
    def readable(self) -> bool:
        """True if every clause is in canonical words."""
        return all(ask.task != "unreadable" for ask in self.asks)


class Obstacle(NamedTuple):
    """The reason why an ask cannot be carried out, with its place, asset or kind."""

    problem: Literal["closed", "no place", "no asset", "down", "low", "poor link", "wrong kind"]
    subject: str = ""
    kind: AssetKind | None = None
    """For a wrong kind, the kind that does not have the command."""


Find = Callable[[str], Obstacle | None]
"""A function that returns the obstacle of the asset with the given name, if it has one."""


def obstacle(ask: Ask, world: World, find: Find) -> Obstacle | None:
    """Return the obstacle to all of `ask`, or None if any part of it can be carried out.

    `find` returns the obstacle that keeps a named asset from doing its part.
    """
    if ask.place in world.zones:
        return Obstacle("closed", ask.place)
    if ask.place not in world.frames and (ask.place or ask.task in PLACED):
        return Obstacle("no place", ask.place)
    if ask.leaving and ask.leaving not in world.assets:
        return Obstacle("no asset", ask.leaving)
    names, kind = ask.who.names, ask.who.kind
    problems = [problem for name in names if (problem := find(name)) is not None]
    all_or_none = ask.strict_who or ask.task == "swap"
    if problems and (all_or_none or len(problems) == len(names)):
        return problems[0]
    if not names and kind is not None and not can_do(kind, ask.task):
        return Obstacle("wrong kind", kind=kind)
    return None


def asset_obstacles(name: str, ask: Ask, world: World, picture: Picture) -> Iterator[Obstacle]:
    """Yield every obstacle that keeps the asset `name` from doing its part of `ask`."""
    asset = picture.assets.get(name)
    if name not in world.assets:
        yield Obstacle("no asset", name)
    elif asset is None or not asset.available:
        yield Obstacle("down", name)
    else:
        stays = ask.task in STILL_TASKS | {"home"} or ask.place == world.base
        if asset.low_battery and not stays:
            yield Obstacle("low", name)
        if ask.task in VERB_FOR and asset.comms != "ok":
            yield Obstacle("poor link", name)
        if not can_do(asset.kind, ask.task):
            yield Obstacle("wrong kind", name, asset.kind)


def can_do(kind: AssetKind, task: Task) -> bool:
    """Return whether assets of a kind have the command for a task."""
    verb = VERB_FOR.get(task)
    return verb is None or kind in COMMANDS[verb].kinds
