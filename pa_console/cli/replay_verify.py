"""Verifies a session log: how sound it is, who signed it, and what comes of it when run again."""

from dataclasses import asdict, dataclass
from pathlib import Path

import typer

from pa_console.cli.output import BAD_INPUT, FAILED, errors, out, print_json
from pa_console.cli.replay_again import Again, Place, print_again, run_again
from pa_console.session.head import head_path
from pa_console.session.index_check import check_index
from pa_console.session.session_index import index_path
from pa_console.session.verify import VerifyResult, verify
from pa_console.session.witness_check import Statement, check_witness
from pa_console.signing import is_fingerprint, known_keys
from pa_console.tui.words import count


@dataclass(frozen=True)
class Trust:
    """Fingerprints of keys that may have signed besides this machine's, or none at all.

    `witness` is the file with the heads that a witness has seen.
    """

    keys: frozenset[str] = frozenset()
    unsigned: bool = False
    witness: Path | None = None

    def accepts(self, result: VerifyResult) -> bool:
        """Return whether a log is vouched for as far as it has to be."""
        unsigned = self.unsigned and result.ok and result.standing == "not signed"
        return result.intact or unsigned


def show_verified(log: Path, trust: Trust, place: Place | None, json: bool) -> None:
    """Say how sound a log is; a sound one is run again at `place`, unless that is None.

    Leaves with BAD_INPUT for damage, also to what the index of sessions or the witness tells of;
    with FAILED for a log that is sound but not vouched for, or that did not come out equal. Raises
    ValueError for what is no fingerprint.
    """
    for given in trust.keys:
        if not is_fingerprint(given):
            raise ValueError(f"--key {given}: a fingerprint is SHA256: and 43 characters")
    own = known_keys()
    known = own | trust.keys
    result, index = verify(log, known), check_index(log.parent, known)
    seen = check_witness(log, result.session, trust.witness, known) if trust.witness else None
    lost = index.of(log)
    again, problem = _again(log, place) if place is not None and result.ok else (None, "")
    if json:
        run = {"problem": problem} if again is None else again.document()
        found = {"intact": result.intact and not lost, **asdict(result), "again": run}
        print_json({**found, "index": index.told, "witness": seen})
    else:
        _print_result(log, result, own)
        if again is not None:
            print_again(log, again)
        if problem:
            _object(f"{log}: not run again: {problem}; or verify with --chain-only")
        for told in index.told:
            _object(f"{index_path(log.parent)}: {told}")
        if seen is not None:
            _print_statement(log, trust.witness, seen)
    if lost or (seen is not None and seen.line is not None):
        raise typer.Exit(BAD_INPUT)
    if seen is not None and not seen.ok:
        raise typer.Exit(FAILED if result.ok else BAD_INPUT)
    if not trust.accepts(result) or problem or (again is not None and not again.equal):
        raise typer.Exit(FAILED if result.ok else BAD_INPUT)


def _again(log: Path, place: Place) -> tuple[Again | None, str]:
    """Return what came of the session, or why it could not be run again."""
    try:
        return run_again(log, place), ""
    except ValueError as error:
        return None, str(error)


def _print_result(log: Path, result: VerifyResult, own: frozenset[str]) -> None:
    if not result.ok:
        place = f"{log}:{result.first_bad_line}" if result.first_bad_line else str(head_path(log))
        place += f"-{result.last_bad_line}" if result.last_bad_line else ""
        _object(f"{place}: {result.damage}: {result.problem}")
        return
    by = f"signed by {result.key}{' (the key of this machine)' * (result.key in own)}"
    standing = {
        "signed": f"{by}.",
        "open": f"{by} up to line {result.vouched} only." if result.key else "not signed yet.",
        "not signed": "not signed: nothing shows that it was not written anew.",
    }[result.standing]
    told = f"{log}: {count(result.lines, 'line')}, chain intact, {standing}"
    told += f" {result.note[:1].upper()}{result.note[1:]}." if result.note else ""
    out.print(told, markup=False, soft_wrap=True)


def _print_statement(log: Path, witness: Path | None, seen: Statement) -> None:
    """Say whether the log has what its witness has seen."""
    if not seen.ok:
        place = f"{witness}:{seen.line}" if seen.line is not None else f"{witness}"
        _object(f"{place}: {seen.problem}")
        return
    told = f"{log}: has all {count(seen.heads, 'head')} that {witness} has seen, the last after "
    out.print(f"{told}record {seen.records}", markup=False, soft_wrap=True)


def _object(text: str) -> None:
    errors.print(text, markup=False, soft_wrap=True)
