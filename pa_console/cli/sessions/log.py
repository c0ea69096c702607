"""The log of a session with its index and its witness, and the lookup of recorded logs."""

from collections.abc import Callable
from pathlib import Path

import platformdirs
import typer

from pa_console.cli.settings_defaults import settings_of
from pa_console.private_files import nearest_existing
from pa_console.session.log.chain import LogError
from pa_console.session.log.signed_head import URLS, Witness
from pa_console.session.log.writer import LogWriter, default_folder, open_session_log
from pa_console.settings.schema import Settings
from pa_console.signing import load_signer
from pa_console.terminal.output import errors


def open_log(
    settings: Settings,
    session: str,
    on_error: Callable[[LogError], None],
    path: Path | None = None,
    witness: str = "",
    *,
    resumed: bool = False,
) -> LogWriter:
    """Open a signed log at `path`, or a new one in the folder of logs and its index.

    The log of a `resumed` session is continued. Raises ValueError if `witness` is not valid, and
    LogError if the log cannot be opened.
    """
    folder = settings.logs or default_folder()
    target = witness_target(witness) if witness else ""
    if target and not target.startswith(URLS) and _same_disk(Path(target), path or folder):
        warn_about_witness(f"the witness {target} is on the same disk as the log; use another disk")
    return open_session_log(
        session,
        load_signer(),
        path=path,
        folder=folder,
        on_error=on_error,
        witness=Witness(target) if target else None,
        resumed=resumed,
    )


def recorded_log(context: typer.Context, given: Path) -> Path:
    """Return the log that is `given` as a file, as an id or its beginning, or as `last`.

    Raises ValueError if there is no such log, or if the beginning is ambiguous.
    """
    if given.is_file():
        return given
    if len(given.parts) > 1 or given.suffix:
        raise ValueError(f"{given}: there is no such log")
    from pa_console.session.past_sessions import find_session  # noqa: PLC0415 - only without a file

    return find_session(settings_of(context).values.logs or default_folder(), str(given))


def witness_target(given: str) -> str:
    """Return the address or absolute path of a witness; raises ValueError if it is not valid."""
    if given.startswith(URLS):
        return given
    if "://" in given:
        raise ValueError(f"--witness {given}: give a file, or an address with {' or '.join(URLS)}")
    path = Path(given).expanduser().absolute()
    if path.is_dir():
        raise ValueError(f"--witness {given}: this is a folder; give a file")
    return str(path)


def warn_about_witness(text: str) -> None:
    """Report a problem with a witness on stderr."""
    errors.print_line(f"warning: {text}", style="yellow")


def warn(error: LogError) -> None:
    """Report at once that the log or its index cannot be written."""
    errors.print_line(f"warning: {error}", style="bold red")


def usual_file() -> Path:
    """Return the path of the file with the usual duration of each step of this user's missions."""
    return platformdirs.user_state_path("pa-console") / "usual-times.json"


def report_witness_problem(log: LogWriter) -> None:
    """Report on stderr if the witness did not receive the last head of a closed log."""
    if log.witness_problem:
        warn_about_witness(
            f"the witness did not receive the last head of the log: {log.witness_problem}"
        )


def _same_disk(first: Path, second: Path) -> bool:
    return nearest_existing(first).stat().st_dev == nearest_existing(second).stat().st_dev
