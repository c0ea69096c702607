"""Holds a session log against what its witness has seen of it."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from pa_console.session.chain import LogError, os_error, parse
from pa_console.session.head import Head, parse_head
from pa_console.session.reader import read_lines
from pa_console.signing import fingerprint


@dataclass(frozen=True)
class Statement:
    """What a witness says of a log: so many `heads` of its session, and what does not fit.

    `line` is that of the first head that the log no longer has; `records` are vouched for.
    """

    heads: int
    records: int = 0
    line: int | None = None
    problem: str = ""

    @property
    def ok(self) -> bool:
        """Whether the witness knows the session, and the log has every head that it has seen."""
        return not self.problem


def check_witness(log: Path, session: str, witness: Path, known: Collection[str]) -> Statement:
    """Hold `log`, of `session`, against the file `witness`.

    Heads signed by keys whose fingerprints are not `known` say nothing: anybody can make them.
    Raises LogError when a file cannot be read.
    """
    heads = _heads(witness, session, known)
    if not heads:
        problem = f"the witness has no head of session {session!r} that a known key has signed"
        return Statement(0, problem=problem)
    hashes = _hashes(log, {head.seq for _, head in heads})
    good = 0
    for line, head in heads:
        if head.seq and hashes.get(head.seq) != head.hash:
            what = "that record is gone" if head.seq not in hashes else "that record is another one"
            return Statement(
                len(heads),
                good,
                line,
                f"the log no longer has the head that the witness saw after record {head.seq}: "
                f"{what}; records {good + 1} to {head.seq} were cut or written anew since",
            )
        good = max(good, head.seq)
    return Statement(len(heads), good)


def _heads(witness: Path, session: str, known: Collection[str]) -> list[tuple[int, Head]]:
    """Return the heads of `session`, each with its line; what is none says nothing."""
    found: list[tuple[int, Head]] = []
    try:
        with witness.open("rb") as file:
            for number, line in enumerate(file, start=1):
                try:
                    head = parse_head(line)
                except ValueError:
                    continue
                if head.session == session and fingerprint(head.key) in known:
                    found.append((number, head))
    except OSError as error:
        raise os_error(witness, "read the witness", error) from error
    return found


def _hashes(log: Path, wanted: Collection[int]) -> dict[int, str]:
    """Return the hashes of the records on the `wanted` lines of `log`, as far as it is sound."""
    hashes: dict[int, str] = {}
    try:
        for number, line in read_lines(log):
            if number in wanted:
                hashes[number] = parse(line).hash
    except (ValueError, LogError):
        pass
    return hashes
