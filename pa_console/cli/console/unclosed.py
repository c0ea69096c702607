"""Asks whether a session whose console ended without closing it goes on, or a new one begins."""

import sys
from pathlib import Path

import typer
from rich.text import Text

from pa_console.cli.output import errors
from pa_console.schema.document import DocumentError
from pa_console.schema.incident import Scenario
from pa_console.schema.text import clock_text, visible
from pa_console.session.log.chain import LogError
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.station.assembly import Site
from pa_console.station.earlier_session import (
    NotResumableError,
    ResumedSession,
    UnclosedSession,
    find_unclosed,
    resume,
)

SHOWN = 5
"""The number of missions and alarms that are named; the rest are counted."""


def choose_session(
    folder: Path, site: Site, model_sha256: str, scenario: str | None, wanted: bool | None
) -> tuple[ResumedSession, Path] | None:
    """Return the unclosed session of the site's world and its log, if it is to go on.

    It says what was under way. `wanted` is the answer where it was given on the command line; else
    the operator is asked, and without a terminal a new session begins. A session that cannot go on
    as it was is told of, and a new one begins; ValueError when it was explicitly `wanted`.
    """
    if wanted is False:
        return None
    found = find_unclosed(folder, site.world_sha256)
    if found is None:
        if wanted:
            raise ValueError("no session of this world was left unclosed; start without --resume")
        return None
    _tell(found)
    problem = _problem(found, site, model_sha256, scenario)
    if not problem and wanted is None and not _asked():
        return None
    if not problem:
        try:
            with errors.status("bringing the session back"):
                return resume(found, site.world, _scenario(found, site)), found.log
        except (NotResumableError, LogError) as error:
            problem = str(error)
    if wanted:
        raise ValueError(f"this session cannot go on: {problem}")
    errors.print(f"It cannot go on: {problem}. A new session begins.", style="yellow",
                 markup=False, soft_wrap=True)  # fmt: skip
    return None


def _asked() -> bool:
    if not sys.stdin.isatty():
        errors.print("A new session begins; --resume goes on with that one.", markup=False)
        return False
    question = "Go on from there? Nothing is dispatched by that. No begins anew"
    return typer.confirm(question, default=True, err=True)


def _problem(found: UnclosedSession, site: Site, model_sha256: str, scenario: str | None) -> str:
    """Return why the session cannot go on as it was; empty when it can be tried."""
    started = found.started
    if scenario is not None and scenario not in (started.scenario, f"{started.scenario}.yaml"):
        played = f"the scenario {started.scenario!r}" if started.scenario else "no scenario"
        return f"it played {played}, and --scenario {scenario} was asked for"
    seal = site.rulebook.seal
    content = started.rules_seal.content_sha256 if started.rules_seal is not None else ""
    if started.rules_sha256 != site.rulebook.sha256 and content != seal.content_sha256:
        return "the rules have changed since"
    if started.model_sha256 != model_sha256:
        return f"it ran with the model {started.model!r}"
    try:
        _scenario(found, site)
    except (DocumentError, ValueError) as error:
        return str(error)
    return ""


def _scenario(found: UnclosedSession, site: Site) -> Scenario | None:
    """Return the scenario of the session, None without one; ValueError when it has changed."""
    started = found.started
    if not started.scenario:
        return None
    loaded = open_scenario(site.world, site.world_path, started.scenario)
    if started.scenario_sha256 not in ("", loaded.sha256):
        raise ValueError(f"the scenario {started.scenario!r} has changed since")
    return loaded.scenario


def _tell(found: UnclosedSession) -> None:
    """Show the session that was left open, and its open missions, alarms and stop."""
    state, started = found.state, found.started
    picture = state.picture
    at = f", {clock_text(picture.time_s)} into it" if picture is not None else ""
    scenario = f", {started.scenario}" if started.scenario else ""
    lines = [f"The session {started.session}{scenario} ended without being closed{at}."]
    for trace in found.interrupted:
        said = f"{trace.mission.id} {trace.mission.said!r} ({trace.stage})"
        lines.append(f"  under way  {said}: it ends as held")
    lines += _named("waiting", [f"{e.mission.id} {e.mission.said!r}" for e in found.waiting])
    lines += _named("alarm", [f"{a.alarm.priority}: {a.alarm.text}" for a in state.alarms])
    if state.stop is not None:
        lines.append("  stop       everything is stopped, and stays so until it is released")
    if not found.unfinished:
        lines.append("  no mission was under way, none waited, and no alarm was open")
    errors.print(Text(visible("\n".join(lines))), soft_wrap=True)


def _named(word: str, texts: list[str]) -> list[str]:
    lines = [f"  {word:<10} {text}" for text in texts[:SHOWN]]
    if len(texts) > SHOWN:
        lines.append(f"  {'':<10} and {len(texts) - SHOWN} more")
    return lines
