"""The command-line options of a console."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.text import Text

from pa_console.cli.sessions.fleet import find_fleet, load_authority
from pa_console.llm.local.engine import Engine
from pa_console.llm.remote.servers import NO_SERVERS, Servers, SessionModels, session_models
from pa_console.policy.pinned_rules import RefusedRulesError, RulesPins
from pa_console.schema.document import DocumentError
from pa_console.schema.incident import Scenario
from pa_console.schema.text import clock_text, visible
from pa_console.session.log.chain import LogError
from pa_console.session.log.writer import LogWriter, default_folder
from pa_console.settings.schema import Settings
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import RealTimeClock
from pa_console.station.earlier_session import (
    NotResumableError,
    ResumedSession,
    UnclosedSession,
    find_unclosed,
    resume,
)
from pa_console.station.rules_in_force import RulesWatch
from pa_console.station.station import Station
from pa_console.terminal.output import errors

if TYPE_CHECKING:
    from pa_console.fleets.station_authority import StationAuthority
    from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet


@dataclass(frozen=True)
class Asked:
    """What a console was started with; `resume` is None where the operator is to be asked."""

    world: str
    rules: str
    scenario: str | None
    seed: int
    alarms: bool
    readonly: bool
    unsigned: bool
    accept_rules: bool
    resume: bool | None
    fleet: str = ""
    certificates: Path | None = None


def chosen_models(model: str | None, settings: Settings) -> SessionModels:
    """Return the models that `model` (else the settings) and the settings name."""
    return session_models(model, settings.judge_server, settings.second_reader)


def open_servers(chosen: SessionModels, settings: Settings) -> Servers:
    """Return the engines of the servers that were named; nothing is sent yet.

    Raises ModelError for an address that is none, or that words may not be sent to.
    """
    return Servers.open(
        chosen.named, plain=settings.plain_servers, patience_s=settings.server_patience_s
    )


@dataclass(frozen=True)
class LiveSession:
    """A station in real time; `log` is that of a session that goes on, None for a new one.

    `authority` signs there, None where a site has no keys.
    """

    site: Site
    station: Station
    log: Path | None
    fleet: "MqttFleet | None" = None
    """The fleet on a message bus, if there is one."""
    authority: "StationAuthority | None" = None

    def share(self, writer: LogWriter) -> None:
        """Share the session that `writer` logs with others on the bus, where the site has keys."""
        if self.fleet is None or self.authority is None or not self.authority.name:
            return
        from pa_console.fleets.vda5050.sharing import SharedSession  # noqa: PLC0415 - on a bus

        authority = self.authority
        shared = SharedSession(writer.session, authority.name, writer.path, authority.vouch)
        writer.on_record = shared.add
        self.fleet.share(shared)


def open_live(
    asked: Asked,
    settings: Settings,
    engine: Engine,
    servers: Servers = NO_SERVERS,
    authority: "StationAuthority | None" = None,
) -> LiveSession:
    """Open the session for the options; raises DocumentError or ValueError if it cannot be opened.

    `authority` has the keys to sign with, if they were loaded before. Rules that are refused, and a
    session that was not closed, are shown and asked about on the terminal.
    """
    pins, deadline_s = RulesPins(), settings.check_deadline_ms / 1000.0
    on_bus = find_fleet(asked.fleet, asked.certificates, asked.world, settings, asked.scenario)
    site = _open_site(replace(asked, world=on_bus.world), pins, deadline_s)
    watch = None
    if site.rules_path is not None:
        watch = RulesWatch(
            site.rules_path, unsigned=asked.unsigned, pins=pins, deadline_s=deadline_s
        )
    played = None
    if asked.scenario:
        played = open_scenario(site.world, site.world_path, asked.scenario)
    chosen = None
    if not asked.readonly and not asked.fleet:
        folder = settings.logs or default_folder()
        chosen = choose_session(folder, site, engine.model.sha256, asked.scenario, asked.resume)
    resumed, log = chosen if chosen is not None else (None, None)
    authority = authority or load_authority()
    fleet = on_bus.drive(site, authority)
    station = open_station(
        site,
        engine,
        on_bus.clock(RealTimeClock()),
        seed=asked.seed,
        readonly=asked.readonly,
        scenario=played,
        respond=asked.alarms,
        watch=watch,
        resumed=resumed,
        authority=authority,
        fleet=fleet,
        servers=servers,
    )
    station.rate = settings.speed
    return LiveSession(site, station, log, fleet, authority)


def _open_site(asked: Asked, pins: RulesPins, deadline_s: float) -> Site:
    """Load world and rules; those that are refused are offered to the operator on the terminal."""

    def load(*, accept: bool) -> Site:
        return load_site(
            asked.world,
            asked.rules,
            unsigned=asked.unsigned,
            pins=pins,
            accept=accept,
            deadline_s=deadline_s,
        )

    try:
        return load(accept=asked.accept_rules)
    except RefusedRulesError as error:
        if not _accepted(error):
            raise
        return load(accept=True)


def _accepted(error: ValueError) -> bool:
    """Ask on the terminal whether refused rules go in force all the same; Enter means no."""
    errors.print_line(str(error), style="bold red")
    return sys.stdin.isatty() and typer.confirm("Put these rules in force?", default=False)


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
                return resume(found, site.world, _scenario_of(found, site)), found.log
        except (NotResumableError, LogError) as error:
            problem = str(error)
    if wanted:
        raise ValueError(f"this session cannot go on: {problem}")
    errors.print_line(f"It cannot go on: {problem}. A new session begins.", style="yellow")
    return None


def _asked() -> bool:
    if not sys.stdin.isatty():
        errors.print("A new session begins; --resume goes on with that one.")
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
        _scenario_of(found, site)
    except (DocumentError, ValueError) as error:
        return str(error)
    return ""


def _scenario_of(found: UnclosedSession, site: Site) -> Scenario | None:
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
    errors.print_line(Text(visible("\n".join(lines))))


def _named(word: str, texts: list[str]) -> list[str]:
    lines = [f"  {word:<10} {text}" for text in texts[:SHOWN]]
    if len(texts) > SHOWN:
        lines.append(f"  {'':<10} and {len(texts) - SHOWN} more")
    return lines
