"""What an order may depend on: in words, how the digest tells of it, and whether it is so.

The words are those in which a trained planner says what it has understood. What a condition comes
to is no matter of judgement: the digest decides it, and a reason can state nothing else.
"""

from collections.abc import Iterable, Iterator
from typing import Literal

from pydantic import Field

from pa_console.llm.roles.compact_prompt import asset_state, standing
from pa_console.llm.roles.prompt_facts import WORDS
from pa_console.orders.digest_tracks import DigestTrack, tracks_of_digest
from pa_console.schema.base import StrictModel
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import AssetKind, World

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
"""What an order may depend on, as far as the picture tells it."""
TrackKind = Literal["vehicle", "person", ""]
_TRACKS: tuple[TrackKind, ...] = ("", "vehicle", "person")
_PRESENCE: tuple[Fact, ...] = ("track_at", "no_track_at")
_KNOWN: tuple[Fact, ...] = ("authorized", "unauthorized", "hostile")
_COVER: tuple[Fact, ...] = ("uncovered", "covered")
_STATE: tuple[Fact, ...] = ("low", "not_low", "down", "up")
_SPARE: tuple[Fact, ...] = ("free", "none_free")


class Condition(StrictModel):
    """What must be so for the order to apply."""

    fact: Fact
    subject: str = Field(default="", description="a gate for tracks and cover, else an asset")
    track: TrackKind = ""
    kind: AssetKind | None = Field(default=None, description="of which one is free, or none")


def conditions(world: World, digest: Digest) -> Iterator[Condition]:
    """Yield every condition about the gates and assets of which `digest` tells."""
    for gate in digest.covered:
        for fact in (*_PRESENCE, *_KNOWN):
            for kind in _TRACKS:
                yield Condition(fact=fact, subject=gate, track=kind)
        for fact in _COVER:
            yield Condition(fact=fact, subject=gate)
    for name in told_assets(world, digest):
        for fact in _STATE:
            yield Condition(fact=fact, subject=name)
    for fact in _SPARE:
        for team in (*WORDS, None):
            yield Condition(fact=fact, kind=team)


def told_assets(world: World, digest: Digest) -> list[str]:
    """Return the assets of which `digest` tells: of a large world, those that were selected."""
    if digest.selection is None:
        return list(world.assets)
    return [name for name in world.assets if name in digest.posts or name in digest.down]


def told_frames(world: World, digest: Digest) -> Iterable[str]:
    """Return the frames of which `digest` tells: of a large world, those that were selected."""
    if digest.selection is None:
        return world.frames
    return dict.fromkeys((*digest.covered, *digest.selection.frames))


def in_words(condition: Condition) -> str:
    """Return the condition as a reason puts it after its `if`."""
    subject, track = condition.subject, condition.track or "track"
    match condition.fact:
        case "track_at":
            return f"{track} at {subject}"
        case "no_track_at":
            return f"no {track} at {subject}"
        case "authorized" | "unauthorized" | "hostile":
            return f"{track} at {subject} {condition.fact}"
        case "not_low":
            return f"{subject} not low"
        case "free" | "none_free":
            word = WORDS[condition.kind] if condition.kind is not None else "asset"
            return f"{'no ' if condition.fact == 'none_free' else ''}{word} free"
        case fact:
            return f"{subject} {fact}"


def evidence(condition: Condition, digest: Digest) -> str:
    """Return what the compact picture tells of the condition, as far as that decides it.

    What the picture says comes before whether it is so: a small model reads a line again far better
    than it decides from memory.
    """
    subject = condition.subject
    match condition.fact:
        case "track_at" | "no_track_at":
            return f"At {subject}: {_listed(subject, digest)}"
        case "authorized" | "unauthorized" | "hostile":
            there = _there(condition, digest)
            decides = [contact for contact in there if _is(contact, condition.fact)]
            told = [f"{one.id} {one.kind}, {one.known}" for one in (*decides, *there)]
            return f"At {subject}: {told[0] if told else 'no track'}"
        case "uncovered" | "covered":
            return f"{subject}: {guard(subject, digest)}"
        case "low" | "not_low" | "down" | "up":
            return f"{subject}: {asset_state(digest, subject) if _up(subject, digest) else 'down'}"
        case "free" | "none_free":
            for kind in WORDS if condition.kind is None else (condition.kind,):
                if digest.free[kind]:
                    return f"Free {WORDS[kind]}: {digest.free[kind][0]}"
            return f"Free{'' if condition.kind is None else ' ' + WORDS[condition.kind]}: none"


def holds(condition: Condition, digest: Digest) -> bool | None:  # noqa: PLR0911
    """Return whether the condition is so, None where the digest does not tell.

    Nothing is so of what is not there. The battery of an asset that is down is not told.
    """
    subject = condition.subject
    if condition.fact in ("low", "not_low") and not _up(subject, digest):
        return None
    match condition.fact:
        case "track_at":
            return bool(_there(condition, digest))
        case "no_track_at":
            return not _there(condition, digest)
        case "authorized" | "unauthorized" | "hostile":
            return any(_is(contact, condition.fact) for contact in _there(condition, digest))
        case "uncovered":
            return subject in digest.uncovered
        case "covered":
            return subject not in digest.uncovered
        case "low":
            return subject in digest.low_battery
        case "not_low":
            return subject not in digest.low_battery
        case "down":
            return not _up(subject, digest)
        case "up":
            return _up(subject, digest)
        case "free":
            return _some_free(condition.kind, digest)
        case "none_free":
            return not _some_free(condition.kind, digest)


def guard(gate: str, digest: Digest) -> str:
    """Return who stands at a gate, the first of several, or that nobody does."""
    sole = digest.sole_cover.get(gate)
    return sole or next(iter(standing(digest).get(gate, ())), "nobody")


def _listed(gate: str, digest: Digest) -> str:
    every = [contact for contact in tracks_of_digest(digest.tracks) if contact.gate == gate]
    here = [f"{contact.id} {contact.kind}" for contact in every if contact.here]
    return ", ".join(here or [f"{contact.id} leaves" for contact in every]) or "no track"


def _there(condition: Condition, digest: Digest) -> list[DigestTrack]:
    return [
        contact
        for contact in tracks_of_digest(digest.tracks)
        if contact.gate == condition.subject and contact.here
        if condition.track in ("", contact.kind)
    ]


def _is(contact: DigestTrack, fact: str) -> bool:
    return fact in (contact.identity, contact.intent)


def _up(name: str, digest: Digest) -> bool:
    return name in digest.posts


def _some_free(kind: AssetKind | None, digest: Digest) -> bool:
    return any(digest.free[each] for each in (WORDS if kind is None else (kind,)))
