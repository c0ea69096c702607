"""The tracks of a digest, read back from its lines."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class DigestTrack:
    """A track as its line in the digest tells of it; `facts` are what follows the distance."""

    id: str
    kind: str
    status: str
    gate: str
    facts: frozenset[str]

    @property
    def here(self) -> bool:
        """Whether it does not leave."""
        return self.status != "leaving"

    @property
    def identity(self) -> str:
        """Return authorized or unauthorized, '' while nobody knows."""
        return next((one for one in ("authorized", "unauthorized") if one in self.facts), "")

    @property
    def intent(self) -> str:
        """Return unknown, benign or hostile."""
        words = (fact.partition("intent ")[2] for fact in self.facts)
        return next(filter(None, words), "unknown")

    @property
    def step(self) -> str:
        """Return in words how far the workflow has come with it (WF-01)."""
        if "not observed" in self.facts:
            return "not observed"
        if not self.identity:
            return "not identified"
        return (
            f"{self.intent}, warned" if "warned" in self.facts else f"{self.identity}, not warned"
        )

    @property
    def known(self) -> str:
        """Return in words who it is, as far as anybody knows."""
        if self.identity:
            return f"{self.identity}, intent {self.intent}"
        return f"not identified{', intent hostile' if self.intent == 'hostile' else ''}"


def tracks_of_digest(lines: Iterable[str]) -> list[DigestTrack]:
    """Return the tracks of a digest, those that are hostile first, else in their order."""
    return sorted(_read(lines), key=lambda contact: contact.intent != "hostile")


def _read(lines: Iterable[str]) -> Iterator[DigestTrack]:
    for line in lines:
        name, _, told = line.partition(": ")
        what, _, *facts = told.split(", ")
        kind, where, *_, gate = what.split()
        status = "approaching" if where == "approaches" else where
        yield DigestTrack(name, kind, status, gate, frozenset(facts))
