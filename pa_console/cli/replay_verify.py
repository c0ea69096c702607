"""Verifies a session log: how sound it is, who signed it, and what comes of it when run again."""

from dataclasses import asdict, dataclass
from pathlib import Path

import typer

from pa_console.cli.output import BAD_INPUT, FAILED, errors, out, print_json
from pa_console.cli.replay_again import Again, Place, print_again, run_again
from pa_console.session.head import head_path
from pa_console.session.verify import VerifyResult, verify
from pa_console.signing import is_fingerprint, known_keys
from pa_console.tui.words import count


@dataclass(frozen=True)
class Trust:
    """Fingerprints of keys that may have signed besides this machine's, or none at all."""

    keys: frozenset[str] = frozenset()
    unsigned: bool = False

    def accepts(self, result: VerifyResult) -> bool:
        """Return whether a log is vouched for as far as it has to be."""
        unsigned = self.unsigned and result.ok and result.standing == "not signed"
        return result.intact or unsigned


def show_verified(log: Path, trust: Trust, place: Place | None, json: bool) -> None:
    """Say how sound a log is; a sound one is run again at `place`, unless that is None.

    Leaves with BAD_INPUT for damage, with FAILED for a log that is sound but not vouched for, or
    that did not come out equal. Raises ValueError for what is no fingerprint.
    """
    for given in trust.keys:
        if not is_fingerprint(given):
            raise ValueError(f"--key {given}: a fingerprint is SHA256: and 43 characters")
    own = known_keys()
    result = verify(log, own | trust.keys)
    again, problem = _again(log, place) if place is not None and result.ok else (None, "")
    if json:
        run = {"problem": problem} if again is None else again.document()
        print_json({"intact": result.intact, **asdict(result), "again": run})
    else:
        _print_result(log, result, own)
        if again is not None:
            print_again(log, again)
        if problem:
            _object(f"{log}: not run again: {problem}; or verify with --chain-only")
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


def _object(text: str) -> None:
    errors.print(text, markup=False, soft_wrap=True)
