"""The live session that every front end opens, new or resumed, with its site, station and log."""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from rich.text import Text

from pa_console.cli.options import SessionOptions
from pa_console.cli.sessions.fleet import find_fleet, load_authority
from pa_console.cli.sessions.log import open_log, warn
from pa_console.end_signals import end_signals
from pa_console.language.orders.patrols import PatrolLimits
from pa_console.llm.local.confinement import require_all, try_out
from pa_console.llm.local.engine import Engine
from pa_console.llm.remote.servers import NO_SERVERS, Servers
from pa_console.mission.orders.agenda import TimingLimits
from pa_console.policy.pinned_rules import RefusedRulesError, RulesPins
from pa_console.schema.document import DocumentError
from pa_console.schema.incident import Scenario
from pa_console.schema.text import clock_text, visible
from pa_console.session.log.chain import LogError
from pa_console.session.log.writer import LogWriter, default_folder
from pa_console.settings.schema import Settings
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import RealTimeClock, SteppedClock
from pa_console.station.earlier.unclosed_session import (
    NotResumableError,
    ResumedSession,
    UnclosedSession,
    find_unclosed,
    resume,
)
from pa_console.station.rules_in_force import RulesWatch
from pa_console.station.station import ControlStation
from pa_console.terminal.output import errors, warn_of_altered
from pa_console.views.trace_layout import step_name

if TYPE_CHECKING:
    from pa_console.fleets.station_authority import StationAuthority
    from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet

SHOWN = 5
"""The number of missions and alarms that are listed; the rest are counted."""


@dataclass(frozen=True)
class LiveSession:
    """A session that is ready to start: its station, its model and the place of its log."""

    options: SessionOptions
    settings: Settings
    site: Site
    station: ControlStation
    engine: Engine
    duration_s: float
    """The duration of the scenario in simulated seconds; 0 if there is none."""
    resumed_log: Path | None
    """The log of a resumed session; None for a new session."""
    bus: "MqttFleet | None"
    """The part of the fleet on a message bus, if there is one."""
    authority: "StationAuthority | None"
    """The signer of approvals and commands; None if the site has no keys."""

    def open_log(self, on_error: Callable[[LogError], None] = warn) -> LogWriter:
        """Open the log, and share it on the bus; raises LogError if the log cannot be opened.

        The session of a script is not shared, because it ends with its mission.
        """
        writer = open_log(
            self.settings,
            self.station.session,
            on_error,
            self.resumed_log or self.options.log,
            self.options.witness,
            resumed=self.resumed_log is not None,
        )
        authority = self.authority
        shares = authority is not None and authority.name and not self.options.stepped
        if self.bus is not None and authority is not None and shares:
            from pa_console.fleets.vda5050.sharing import SharedSession  # noqa: PLC0415 - on a bus

            shared = SharedSession(writer.session, authority.name, writer.path, authority.vouch)
            writer.on_record = shared.add
            self.bus.share(shared)
        return writer

    @contextmanager
    def logged(self, writer: LogWriter, end: Callable[[int], None]) -> Generator[None]:
        """Log the block's session with `writer`; `end` is called with a signal that ends it."""
        with end_signals(end), writer:
            self.station.write_to(writer)
            if not self.options.stepped:
                self.station.take_stills(writer.path)
            yield


def open_live(
    options: SessionOptions,
    settings: Settings,
    engine: Callable[[], Engine],
    servers: Servers = NO_SERVERS,
    authority: "StationAuthority | None" = None,
) -> LiveSession:
    """Open the session for the options; raises DocumentError or ValueError if it cannot be opened.

    If the options require a sandbox, the confinement is tested before anything else. `engine` is
    called for the model once the site is loaded. `authority` has the keys for signatures, if they
    have already been loaded. If the rules are refused, or a session was not closed, the operator is
    asked on the terminal.
    """
    if options.require_sandbox:
        require_all(try_out())
    devices = find_fleet(
        options.fleet or (), options.certificates, options.world, settings, options.scenario
    )
    pins, deadline_s = RulesPins(), settings.check_deadline_ms / 1000.0
    site = _open_site(devices.world, options, pins, deadline_s)
    watch = None
    if options.stepped:
        warn_of_altered(options.rules, site.rulebook.seal)
    elif site.rules_path is not None:
        watch = RulesWatch(
            site.rules_path, unsigned=options.unsigned, pins=pins, deadline_s=deadline_s
        )
    scenario = options.scenario
    played = open_scenario(site.world, site.world_path, scenario) if scenario else None
    model, chosen = engine(), None
    if not options.readonly and not options.fleet:
        folder = settings.logs or default_folder()
        chosen = choose_session(folder, site, model.model.sha256, scenario, options.resume)
    resumed, log = chosen if chosen is not None else (None, None)
    authority = authority or load_authority()
    fleet, bus = devices.drive(site, authority)
    station = open_station(
        site,
        model,
        devices.clock(SteppedClock() if options.stepped else RealTimeClock()),
        seed=options.seed,
        readonly=options.readonly,
        scenario=played,
        respond=options.alarms if options.alarms is not None else played is not None,
        watch=watch,
        resumed=resumed,
        authority=authority,
        fleet=fleet,
        servers=servers,
    )
    patrols = PatrolLimits(settings.patrol_stay_s, settings.patrol_laps)
    station.limit_times(
        TimingLimits(settings.moment_grace_s, settings.shortest_interval_s, patrols)
    )
    if not options.stepped:
        station.rate = settings.speed
    duration_s = played.scenario.duration_s if played is not None else 0.0
    return LiveSession(options, settings, site, station, model, duration_s, log, bus, authority)


def _open_site(world: str, options: SessionOptions, pins: RulesPins, deadline_s: float) -> Site:
    """Return the world and the rules; the operator may accept refused rules on the terminal."""

    def load(*, accept: bool) -> Site:
        return load_site(
            world,
            options.rules,
            unsigned=options.unsigned,
            pins=pins,
            accept=accept,
            deadline_s=deadline_s,
        )

    try:
        return load(accept=options.accept_rules)
    except RefusedRulesError as error:
        if options.stepped or not _accepted(error):
            raise
        return load(accept=True)


def _accepted(error: ValueError) -> bool:
    """Return whether the operator accepts refused rules on the terminal; Enter means no."""
    errors.print_line(str(error), style="bold red")
    return sys.stdin.isatty() and typer.confirm("Put these rules in force?", default=False)


def choose_session(
    folder: Path, site: Site, model_sha256: str, scenario: str | None, wanted: bool | None
) -> tuple[ResumedSession, Path] | None:
    """Return the unclosed session of the site's world with its log, if it is to be resumed.

    Its open missions and alarms are printed. `wanted` is the choice from the command line; if it is
    None, the operator is asked. Without a terminal, a new session starts. If the session cannot be
    resumed, ValueError is raised if `wanted` is True; otherwise, the reason is printed and a new
    session starts.
    """
    if wanted is False:
        return None
    unclosed = find_unclosed(folder, site.world_sha256)
    if unclosed is None:
        if wanted:
            raise ValueError("no unclosed session of this world; start without --resume")
        return None
    _print_unclosed(unclosed)
    problem = _problem(unclosed, site, model_sha256, scenario)
    if not problem and wanted is None and not _asked():
        return None
    if not problem:
        try:
            with errors.status("restoring the session"):
                return resume(unclosed, site.world, _scenario_of(unclosed, site)), unclosed.log
        except (NotResumableError, LogError) as error:
            problem = str(error)
    if wanted:
        raise ValueError(f"the session cannot be resumed: {problem}")
    errors.print_line(f"It cannot be resumed: {problem}. A new session starts.", style="yellow")
    return None


def _asked() -> bool:
    if not sys.stdin.isatty():
        errors.print("A new session starts; to resume the unclosed one, use --resume.")
        return False
    question = "Resume it? Nothing is dispatched automatically. 'n' starts a new session"
    return typer.confirm(question, default=True, err=True)


def _problem(unclosed: UnclosedSession, site: Site, model_sha256: str, scenario: str | None) -> str:
    """Return why the session cannot be resumed; '' if it probably can."""
    started = unclosed.started
    if scenario is not None and scenario not in (started.scenario, f"{started.scenario}.yaml"):
        played = f"the scenario {started.scenario!r}" if started.scenario else "no scenario"
        return f"it played {played}, not {scenario!r}"
    seal = site.rulebook.seal
    content = started.rules_seal.content_sha256 if started.rules_seal is not None else ""
    if started.rules_sha256 != site.rulebook.sha256 and content != seal.content_sha256:
        return "the rules have changed since then"
    if started.model_sha256 != model_sha256:
        return f"it used another model, {started.model!r}"
    try:
        _scenario_of(unclosed, site)
    except (DocumentError, ValueError) as error:
        return str(error)
    return ""


def _scenario_of(unclosed: UnclosedSession, site: Site) -> Scenario | None:
    """Return the scenario of the session, if it has one; raises ValueError if it has changed."""
    started = unclosed.started
    if not started.scenario:
        return None
    loaded = open_scenario(site.world, site.world_path, started.scenario)
    if started.scenario_sha256 not in ("", loaded.sha256):
        raise ValueError(f"the scenario {started.scenario!r} has changed since then")
    return loaded.scenario


def _print_unclosed(unclosed: UnclosedSession) -> None:
    """Print the session that was not closed, with its open missions, alarms and stop."""
    state, started = unclosed.state, unclosed.started
    picture = state.picture
    at = f", after {clock_text(picture.time_s)}" if picture is not None else ""
    scenario = f", {started.scenario}" if started.scenario else ""
    lines = [f"The session {started.session}{scenario} ended without being closed{at}."]
    for trace in unclosed.interrupted:
        mission = f"{trace.mission.id} {trace.mission.said!r} ({step_name(trace)})"
        lines.append(f"  active     {mission}: will be held")
    lines += _named("waiting", [f"{e.mission.id} {e.mission.said!r}" for e in unclosed.waiting])
    lines += _named("alarm", [f"{a.alarm.priority}: {a.alarm.text}" for a in state.alarms])
    if state.stop is not None:
        lines.append("  stop       all assets stay stopped until you release them")
    if not unclosed.unfinished:
        lines.append("  no active or waiting mission, and no open alarm")
    errors.print_line(Text(visible("\n".join(lines))))


def _named(word: str, texts: list[str]) -> list[str]:
    lines = [f"  {word:<10} {text}" for text in texts[:SHOWN]]
    if len(texts) > SHOWN:
        lines.append(f"  {'':<10} and {len(texts) - SHOWN} more")
    return lines
