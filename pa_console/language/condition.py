"""The conditions of orders: in canonical and in plain words, and their truth.

The truth of a condition is no matter of judgement. It is decided on facts that a picture gives as
well as its digest (`picture_facts.py`, `digest_facts.py`).
"""

from collections.abc import Iterable, Mapping
from typing import Literal, NamedTuple, Protocol

from pydantic import Field

from pa_console.language.word_form import WordForm
from pa_console.schema.base import StrictModel
from pa_console.schema.world import PLAIN_KINDS, AssetKind

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
"""A fact that an order may depend on, as far as the picture shows it."""
TrackKind = Literal["vehicle", "person", ""]


class Condition(StrictModel):
    """The condition under which the order applies."""

    fact: Fact
    subject: str = Field(default="", description="a gate for tracks and cover, else an asset")
    track: TrackKind = ""
    kind: AssetKind | None = Field(default=None, description="of which one is free, or none")


class ConditionForm(NamedTuple):
    """The form of a condition after an `if`, in canonical words and in plain words for people."""

    words: WordForm
    plain: WordForm


def _form(words: str, plain: str) -> ConditionForm:
    return ConditionForm(WordForm(words), WordForm(plain))


def _known(fact: Fact) -> ConditionForm:
    """Return the words for the known identity of a contact."""
    return _form(
        f"({{track}}|track) at {{subject}} {fact}",
        f"(the {{track}} at {{subject}}|what is at {{subject}}) is {fact}",
    )


CONDITIONS: Mapping[Fact, ConditionForm] = {
    "track_at": _form("({track}|track) at {subject}", "(a {track}|something) is at {subject}"),
    "no_track_at": _form("no ({track}|track) at {subject}", "(no {track}|nothing) is at {subject}"),
    "authorized": _known("authorized"),
    "unauthorized": _known("unauthorized"),
    "hostile": _known("hostile"),
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
    """Return the condition as a reason puts it after its `if`."""
    said = {"subject": condition.subject}
    if condition.track:
        said["track"] = condition.track
    if condition.kind is not None:
        said["kind"] = PLAIN_KINDS[condition.kind]
    return CONDITIONS[condition.fact].words.write(said)


class TrackFacts(Protocol):
    """The known facts of a track."""

    @property
    def kind(self) -> str:
        """Return vehicle or person."""
        ...

    @property
    def identity(self) -> str:
        """Return authorized or unauthorized, another word while it is unknown."""
        ...

    @property
    def intent(self) -> str:
        """Return unknown, benign or hostile."""
        ...


class Facts(Protocol):
    """The facts that a condition can depend on, None if they are unknown."""

    def tracks(self, gate: str) -> Iterable[TrackFacts]:
        """Return the tracks at a gate that do not leave."""
        ...

    def is_covered(self, gate: str) -> bool | None:
        """Return whether a gate has a guard."""
        ...

    def is_low(self, asset: str) -> bool | None:
        """Return whether the battery of an asset is low."""
        ...

    def is_up(self, asset: str) -> bool | None:
        """Return whether an asset works."""
        ...

    def has_free(self, kind: AssetKind | None) -> bool:
        """Return whether an asset of a kind, or any, may be sent somewhere."""
        ...


def holds(condition: Condition, facts: Facts) -> bool | None:
    """Return whether the condition is true, None if the facts do not decide it."""
    subject = condition.subject
    match condition.fact:
        case "track_at":
            return bool(there(condition, facts))
        case "no_track_at":
            return not there(condition, facts)
        case "authorized" | "unauthorized" | "hostile":
            return any(decides(condition, track) for track in there(condition, facts))
        case "covered" | "uncovered":
            so, told = condition.fact == "covered", facts.is_covered(subject)
        case "low" | "not_low":
            so, told = condition.fact == "low", facts.is_low(subject)
        case "up" | "down":
            so, told = condition.fact == "up", facts.is_up(subject)
        case "free" | "none_free":
            so, told = condition.fact == "free", facts.has_free(condition.kind)
    return None if told is None else told is so


def there(condition: Condition, facts: Facts) -> list[TrackFacts]:
    """Return the tracks that a condition is about."""
    here = facts.tracks(condition.subject)
    return [track for track in here if condition.track in ("", track.kind)]


def decides(condition: Condition, track: TrackFacts) -> bool:
    """Return whether a track makes a condition about a contact true."""
    return condition.fact in (track.identity, track.intent)
