"""Facts of a digest on which the conditions of orders depend.

A trained planner's reading states these facts in these words; a reason can state no other facts.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from pa_console.language.canonical.order import Condition, Fact, TrackKind
from pa_console.schema.command import BUSY_TASKS
from pa_console.schema.telemetry import AssetTelemetry, Digest, Picture, Track
from pa_console.schema.world import PLAIN_KINDS, AssetKind, World

_TRACKS: tuple[TrackKind, ...] = ("", "vehicle", "person")
_PRESENCE: tuple[Fact, ...] = ("track_at", "no_track_at")
_TRAITS: tuple[Fact, ...] = ("authorized", "unauthorized", "hostile")
_COVER: tuple[Fact, ...] = ("uncovered", "covered")
_STATE: tuple[Fact, ...] = ("low", "not_low", "down", "up")
_SPARE: tuple[Fact, ...] = ("free", "none_free")


def is_free(asset: AssetTelemetry, sole_covers: Collection[str]) -> bool:
    """Return whether an asset may leave without uncovering a gate or giving up its task."""
    busy = asset.task in BUSY_TASKS
    return asset.available and not busy and not asset.low_battery and asset.id not in sole_covers


def sole_covers(picture: Picture) -> dict[str, str]:
    """Return the gates that are covered by exactly one asset, each with that asset."""
    return {gate: cover.by[0] for gate, cover in picture.gates.items() if len(cover.by) == 1}


@dataclass(frozen=True)
class DigestTrack:
    """A track as described by its line of the digest; `facts` are the parts after the distance."""

    id: str
    kind: str
    status: str
    gate: str
    facts: frozenset[str]

    @property
    def here(self) -> bool:
        """True if the track is not leaving."""
        return self.status != "leaving"

    @property
    def identity(self) -> str:
        """The identity of the track, authorized or unauthorized; '' while it is unknown."""
        return next(
            (identity for identity in ("authorized", "unauthorized") if identity in self.facts), ""
        )

    @property
    def intent(self) -> str:
        """The intent of the track: unknown, benign or hostile."""
        words = (fact.partition("intent ")[2] for fact in self.facts)
        return next(filter(None, words), "unknown")

    @property
    def step(self) -> str:
        """The progress of the workflow for the track, in words (WF-01)."""
        if "not observed" in self.facts:
            return "not observed"
        if not self.identity:
            return "not identified"
        return (
            f"{self.intent}, warned" if "warned" in self.facts else f"{self.identity}, not warned"
        )

    @property
    def identity_words(self) -> str:
        """The identity in words, with the intent if the identity is known or the intent hostile."""
        if self.identity:
            return f"{self.identity}, intent {self.intent}"
        return f"not identified{', intent hostile' if self.intent == 'hostile' else ''}"


class Facts(Protocol):
    """The facts on which a condition can depend; an unknown fact is None."""

    def tracks(self, gate: str) -> Sequence[Track | DigestTrack]:
        """Return the tracks at a gate that are not leaving."""
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
    """Return whether the condition is true; None if the facts do not decide it."""
    subject = condition.subject
    match condition.fact:
        case "track_at":
            return bool(there(condition, facts))
        case "no_track_at":
            return not there(condition, facts)
        case "authorized" | "unauthorized" | "hostile":
            return any(decides(condition, track) for track in there(condition, facts))
        case "covered" | "uncovered":
            expected, fact = condition.fact == "covered", facts.is_covered(subject)
        case "low" | "not_low":
            expected, fact = condition.fact == "low", facts.is_low(subject)
        case "up" | "down":
            expected, fact = condition.fact == "up", facts.is_up(subject)
        case "free" | "none_free":
            expected, fact = condition.fact == "free", facts.has_free(condition.kind)
    return None if fact is None else fact is expected


def there(condition: Condition, facts: Facts) -> list[Track | DigestTrack]:
    """Return the tracks at the condition's gate that are of its kind."""
    here = facts.tracks(condition.subject)
    return [track for track in here if condition.track in ("", track.kind)]


def decides(condition: Condition, track: Track | DigestTrack) -> bool:
    """Return whether a track has the identity or intent that a condition requires."""
    return condition.fact in (track.identity, track.intent)


def tracks_of_digest(lines: Iterable[str]) -> list[DigestTrack]:
    """Return the tracks of a digest, hostile ones first, otherwise in the order of the digest."""
    return sorted(_read(lines), key=lambda contact: contact.intent != "hostile")


def _read(lines: Iterable[str]) -> Iterator[DigestTrack]:
    for line in lines:
        name, _, details = line.partition(": ")
        position, _, *facts = details.split(", ")
        kind, movement, *_, gate = position.split()
        status = "approaching" if movement == "approaches" else movement
        yield DigestTrack(name, kind, status, gate, frozenset(facts))


def asset_state(digest: Digest, name: str) -> str:
    """Return the state of an asset in one or two words, as in the compact picture: *low, alone*."""
    if name in digest.down:
        return "down"
    guards = name in digest.sole_cover.values()
    if name in digest.low_battery:
        return "low, alone" if guards else "low"
    if guards:
        return "alone"
    return "free" if any(name in names for names in digest.free.values()) else "busy"


def standing(digest: Digest) -> dict[str, list[str]]:
    """Return the assets at each gate, and at each other occupied frame."""
    stands: dict[str, list[str]] = {gate: [] for gate in digest.covered}
    for name in digest.posts:
        frame = stands_at(digest, name)
        if frame:
            stands.setdefault(frame, []).append(name)
    return stands


def stands_at(digest: Digest, name: str) -> str:
    """Return the frame where an asset is; '' while it is under way."""
    return digest.posts[name].partition(" at ")[2]


def shown_assets(world: World, digest: Digest) -> list[str]:
    """Return the assets in `digest`; in a large world, only the selected ones."""
    if digest.selection is None:
        return list(world.assets)
    return [name for name in world.assets if name in digest.posts or name in digest.down]


def shown_frames(world: World, digest: Digest) -> Iterable[str]:
    """Return the frames in `digest`; in a large world, only the selected ones."""
    if digest.selection is None:
        return world.frames
    return dict.fromkeys((*digest.covered, *digest.selection.frames))


def conditions(world: World, digest: Digest) -> Iterator[Condition]:
    """Yield every condition about the gates and assets in `digest`."""
    for gate in digest.covered:
        for fact in (*_PRESENCE, *_TRAITS):
            for kind in _TRACKS:
                yield Condition(fact=fact, subject=gate, track=kind)
        for fact in _COVER:
            yield Condition(fact=fact, subject=gate)
    for name in shown_assets(world, digest):
        for fact in _STATE:
            yield Condition(fact=fact, subject=name)
    for fact in _SPARE:
        for team in (*PLAIN_KINDS, None):
            yield Condition(fact=fact, kind=team)


@dataclass(frozen=True)
class DigestFacts:
    """The facts of a digest; the battery state of an asset that is down is unknown."""

    digest: Digest

    def tracks(self, gate: str) -> list[DigestTrack]:
        """Return the tracks at a gate that are not leaving, hostile ones first."""
        every = tracks_of_digest(self.digest.tracks)
        return [track for track in every if track.gate == gate and track.here]

    def is_covered(self, gate: str) -> bool | None:
        """Return whether a gate has a guard; None if the digest has no such gate."""
        return gate not in self.digest.uncovered if gate in self.digest.covered else None

    def is_low(self, asset: str) -> bool | None:
        """Return whether the battery of an asset is low."""
        return asset in self.digest.low_battery if self.is_up(asset) else None

    def is_up(self, asset: str) -> bool:
        """Return whether an asset works."""
        return asset in self.digest.posts

    def has_free(self, kind: AssetKind | None) -> bool:
        """Return whether an asset of a kind, or any, may be sent somewhere."""
        return any(self.digest.free[name] for name in (PLAIN_KINDS if kind is None else (kind,)))


def evidence(condition: Condition, digest: Digest) -> str:
    """Return the facts that decide the condition, in the words of the compact picture.

    A reading states these facts before the conclusion, because a small model is far better at
    copying a line than at deciding from memory.
    """
    subject, facts = condition.subject, DigestFacts(digest)
    match condition.fact:
        case "track_at" | "no_track_at":
            return f"At {subject}: {_listed(subject, digest)}"
        case "authorized" | "unauthorized" | "hostile":
            here = [track for track in facts.tracks(subject) if condition.track in ("", track.kind)]
            deciding = [track for track in here if decides(condition, track)]
            lines = [
                f"{track.id} {track.kind}, {track.identity_words}" for track in (*deciding, *here)
            ]
            return f"At {subject}: {lines[0] if lines else 'no track'}"
        case "uncovered" | "covered":
            return f"{subject}: {guard(subject, digest)}"
        case "low" | "not_low" | "down" | "up":
            return f"{subject}: {asset_state(digest, subject) if facts.is_up(subject) else 'down'}"
        case "free" | "none_free":
            for kind in PLAIN_KINDS if condition.kind is None else (condition.kind,):
                if digest.free[kind]:
                    return f"Free {PLAIN_KINDS[kind]}: {digest.free[kind][0]}"
            track = "" if condition.kind is None else f" {PLAIN_KINDS[condition.kind]}"
            return f"Free{track}: none"


def guard(gate: str, digest: Digest) -> str:
    """Return the first guard at a gate, or the word *nobody*."""
    sole = digest.sole_cover.get(gate)
    return sole or next(iter(standing(digest).get(gate, ())), "nobody")


def _listed(gate: str, digest: Digest) -> str:
    every = [contact for contact in tracks_of_digest(digest.tracks) if contact.gate == gate]
    here = [f"{contact.id} {contact.kind}" for contact in every if contact.here]
    return ", ".join(here or [f"{contact.id} leaves" for contact in every]) or "no track"
