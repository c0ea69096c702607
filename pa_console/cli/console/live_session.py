"""Opens the session of a console, new or going on: its site, its station, where its log is."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from pa_console.cli.console.asked import Asked
from pa_console.cli.console.unclosed import choose_session
from pa_console.cli.fleet import find_fleet
from pa_console.cli.keys.site_keys import load_authority
from pa_console.cli.output import errors
from pa_console.llm.local.engine import Engine
from pa_console.llm.remote.servers import NO_SERVERS, Servers
from pa_console.policy.pinned_rules import RefusedRulesError, RulesPins
from pa_console.session.log.writer import LogWriter, default_folder
from pa_console.settings.schema import Settings
from pa_console.sim.worlds.scenario_file import open_scenario
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import RealTimeClock
from pa_console.station.rules_in_force import RulesWatch
from pa_console.station.station import Station

if TYPE_CHECKING:
    from pa_console.fleets.station_authority import StationAuthority
    from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet


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
    errors.print(str(error), style="bold red", markup=False, soft_wrap=True)
    return sys.stdin.isatty() and typer.confirm("Put these rules in force?", default=False)
