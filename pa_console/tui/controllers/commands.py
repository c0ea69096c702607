"""Commands to the station: missions, alarms, the queue, the stop, and simulated incidents."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

from pa_console.schema import incident as inc
from pa_console.schema.incident import Incident
from pa_console.schema.mission import StandingOrder
from pa_console.schema.telemetry import Weather
from pa_console.schema.world import World
from pa_console.tui.actions import first_key
from pa_console.tui.controllers.console_session import ConsoleSession
from pa_console.tui.controllers.session_feed import SessionFeed
from pa_console.tui.order_templates import slots
from pa_console.tui.surroundings import LiveStation
from pa_console.tui.widgets.alarms import AlarmPane
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.mission_prompt import MissionPrompt

if TYPE_CHECKING:
    from pa_console.tui.screens.standing_orders import StandingChange

LOW_BATTERY_PCT = 15.0
JAM_S = 60.0
JAM_FACTOR = 2.0
"""The radius of a jam around a gate, as a multiple of the gate's radius."""

DRIFT_MPS = 1.0
RATES = (1.0, 2.0, 4.0, 8.0)
_WEATHERS: tuple[Weather, ...] = ("fog", "rain", "clear")

WhatIf = tuple[str, inc.Incident]
"""A title and the incident that it injects."""


_STANDING = {
    "revoke": ("Revoke", "{} starts no more missions; its waiting missions are cancelled"),
    "pause": ("Pause", "{} starts no missions until you resume it"),
    "resume": ("Resume", "{} starts missions again"),
    "skip": ("Skip", "{} skips its next start"),
    "again": ("Give again", "it is in force once you approve it again"),
}


def next_rate(rate: float, factor: float) -> float:
    """Return `rate` times `factor`, limited to the allowed speeds of the simulation."""
    return min(max(rate * factor, RATES[0]), RATES[-1])


def what_ifs(world: World) -> Iterator[WhatIf]:
    """Yield every incident on offer with its title, the usual ones first."""
    radio = world.radio
    works = inc.SetRadio(latency_s=radio.latency_s, jitter_s=radio.jitter_s, loss=radio.loss)
    offers = [
        *((f"unknown vehicle at {gate}", inc.SpawnTrack(gate=gate)) for gate in world.gates),
        *(offer for gate in world.gates for offer in _visitors(world, gate)),
        *((f"weather {weather}", inc.SetWeather(weather=weather)) for weather in _WEATHERS),
        *(offer for camera in world.cameras for offer in _camera_faults(world, camera)),
        *(offer for asset in world.assets for offer in _asset_troubles(world, asset)),
        ("every link is down", inc.SetRadio(up=False)),
        ("every link works", works),
        ("the model's worker process is killed", inc.WorkerFault()),
    ]
    yield from ((f"What if: {title}", incident) for title, incident in offers)


def _visitors(world: World, gate: str) -> Iterator[WhatIf]:
    """Yield the contacts and events at a gate."""
    spawn = partial(inc.SpawnTrack, gate=gate)
    walks = partial(spawn, track="person", speed_mps=1.4)
    frame = world.frames[gate]
    jam = inc.JamArea(at=frame.at, radius_m=JAM_FACTOR * frame.radius_m, seconds=JAM_S)
    yield f"defiant vehicle at {gate}, goes on when warned", spawn(when_warned="go_on")
    hostile = spawn(intent="hostile", when_warned="go_on")
    yield f"hostile vehicle at {gate} that ignores warnings", hostile
    yield f"authorized vehicle at {gate}", spawn(identity="authorized")
    yield f"person at {gate}", walks()
    yield f"noncombatants at {gate}", walks(noncombatants=True)
    yield f"false alarm at {gate}", inc.FalseContact(gate=gate)
    yield f"{gate} is jammed for {JAM_S:g} s", jam
    yield f"tracks at {gate} are gone", inc.ClearTracks(gate=gate)


def _camera_faults(world: World, camera: str) -> Iterator[WhatIf]:
    """Yield the fault of a gate camera, and the end of the fault."""
    gate = world.cameras[camera].gate
    yield f"{camera} of {gate} fails", inc.SensorFault(sensor=camera)
    yield f"{camera} of {gate} works again", inc.SensorFault(sensor=camera, works=True)


def _asset_troubles(world: World, asset: str) -> Iterator[WhatIf]:
    """Yield the faults of an asset, and the end of each."""
    post = world.assets[asset].post
    forged = inc.SpoofTelemetry(asset=asset, frame=post)
    yield f"{asset} fails", inc.FailAsset(asset=asset)
    yield f"{asset} works again", inc.RestoreAsset(asset=asset)
    yield f"{asset} runs at half speed", inc.DegradeAsset(asset=asset, speed_factor=0.5)
    yield f"{asset} battery low", inc.SetBattery(asset=asset, percent=LOW_BATTERY_PCT)
    yield f"{asset} battery full", inc.SetBattery(asset=asset, percent=100.0)
    yield f"{asset} link degraded", inc.SetComms(asset=asset, comms="degraded")
    yield f"{asset} link lost", inc.SetComms(asset=asset, comms="lost")
    yield f"{asset} link ok", inc.SetComms(asset=asset, comms="ok")
    yield f"{asset} goes under manual control", inc.DriveByHand(asset=asset)
    yield f"{asset} ends manual control", inc.DriveByHand(asset=asset, ends=True)
    yield f"{asset} sensor fails", inc.SensorFault(sensor=asset)
    yield f"{asset} sensor works again", inc.SensorFault(sensor=asset, works=True)
    yield f"{asset} telemetry is forged and places it at {post}", forged
    yield f"{asset} telemetry is honest again", inc.SpoofTelemetry(asset=asset, frame=None)
    yield f"{asset} position drifts", inc.GpsDrift(asset=asset, rate_mps=DRIFT_MPS)
    yield f"{asset} position is right again", inc.GpsDrift(asset=asset, rate_mps=0.0)


class CommandController:
    """Commands that the station may refuse; a refusal is shown."""

    def __init__(self, session: ConsoleSession, feed: SessionFeed) -> None:
        self._session, self._feed = session, feed

    def attempt(self, title: str, command: Callable[[LiveStation], object]) -> bool:
        """Give a command to the station; return whether it was accepted."""
        station, joined = self._session.station, self._session.joined
        if station is None or (self._session.readonly and joined is None):
            self._session.tell("the console is read-only", f"{title} refused", bad=True)
            return False
        try:
            command(station)
        except ValueError as error:
            self._session.tell(str(error), f"{title} refused", bad=True)
            return False
        return True

    # Missions and alarms

    def typing(self, text: str) -> None:
        """Pass on the mission as it is being typed, so that the model can read ahead."""
        if self._session.main is not None:
            self._session.main.typing(text)
        if self._session.station is not None:
            self._session.station.typing("" if slots(text) else text)

    def point(self) -> None:
        """Pass the followed item to the station, so that *this one* in an order refers to it."""
        shown = self._session.main
        if self._session.station is not None and shown is not None:
            self._session.station.point(shown.query_one(MapView).followed)

    def take_up(self) -> None:
        """Submit the standing orders of the last session again; each waits for its approval."""
        last = self._session.last
        for order in last.take_up() if last is not None else ():
            self.attempt("Mission", lambda station, text=order: station.submit(text))

    def submit(self, text: str) -> None:
        """Submit a mission; a refused text stays in the field."""
        self.point()
        taken = self.attempt("Mission", lambda station: station.submit(text))
        if taken and self._session.main is not None:
            self._session.main.query_one(MissionPrompt).taken(text)

    def acknowledge(self) -> None:
        """Acknowledge the alarm at the pointer, or else the worst unseen one."""
        if self._session.main is None:
            return
        pane = self._session.main.query_one(AlarmPane)
        item = pane.alarm
        if item is not None:
            name = item.alarm.id
            if self.attempt("Acknowledge", lambda station: station.acknowledge(name)):
                pane.release()

    def mute_agent(self) -> None:
        """Mute the agent that proposed last, or let it propose again."""
        state = self._session.state
        agent = state.last_agent
        muted = agent not in state.muted_agents
        self.attempt("Mute agent", lambda station: station.mute_agent(agent, muted=muted))

    # The queue

    def with_queued(self, title: str, command: Callable[[LiveStation, str], None]) -> None:
        """Give a command for the waiting mission at the pointer, if the pointer is visible.

        Otherwise, only show the pointer.
        """
        main = self._session.main
        if main is None:
            return
        pane = main.query_one(AlarmPane)
        name = pane.mission
        if name and pane.region.area:
            self.attempt(title, lambda station: command(station, name))
            return
        main.focus_view("alarms")
        if not name:
            pane.next_mission()
        self._session.tell(f"{pane.mission} is selected now; press the key again", title)

    # Standing orders

    def show_standing_orders(self) -> None:
        """Show the standing orders of the shown session."""
        from pa_console.tui.screens.standing_orders import StandingOrdersScreen  # noqa: PLC0415

        session = self._session
        if not session.is_open(StandingOrdersScreen):
            screen = StandingOrdersScreen(
                lambda: session.shown_state, session.world.dt_s, self.change_standing
            )
            session.app.push_screen(screen)

    def change_standing(self, order: StandingOrder, change: "StandingChange") -> None:
        """Revoke, pause or resume a standing order, skip one of its moments, or give it again."""
        name = order.id
        title, effect = _STANDING[change]
        if self._session.recording is not None:
            self._session.tell("a recording cannot be changed", f"{title} refused", bad=True)
            return

        def carry_out(station: LiveStation) -> object:
            if change == "again":
                return station.submit(order.text)
            return station.change_standing(name, change)

        if self.attempt(title, carry_out):
            self._session.tell(effect.format(name), title)

    # The stop

    def stop_all(self) -> None:
        """Make every asset hold, at once and without confirmation."""
        joined = self._session.joined
        if not self.attempt("Stop", lambda station: station.stop_all()):
            return
        if joined is not None:
            self._session.tell(
                f"{joined.station} was asked to stop every asset; the red line at the top shows "
                "when it has done so",
                "■ STOP ASKED",
                bad=True,
            )
        else:
            self._session.tell(
                "every asset was ordered to hold, open plans are void, the queue is empty; the red "
                "line at the top shows which assets have confirmed. Nothing else is sent until you "
                f"release the stop ({first_key('release')})",
                "■ ALL STOPPED",
                bad=True,
            )

    def release_stop(self) -> None:
        """Release the stop, after a dialog that names the assets that have not confirmed it."""
        stop = self._session.state.stop
        if stop is None:
            return
        doubtful = f"Not confirmed: {', '.join(stop.unconfirmed)}.\n" if stop.unconfirmed else ""
        question = (
            f"Everything was stopped by {stop.by}. {stop.held} assets confirmed that they hold.\n"
            f"{doubtful}After the release, missions are accepted again, and alarms become "
            "missions.\n"
            "No asset moves before you approve a plan."
        )

        def release() -> None:
            if self.attempt("Release", lambda station: station.release()):
                self._session.tell("missions are accepted again", "The stop was released")

        self._session.confirm(question, release, yes="Release", no="Stay stopped")

    # The simulation

    def inject(self, incident: Incident) -> None:
        """Inject an incident into the simulation."""
        self.attempt("What-if", lambda station: station.inject(incident))

    def set_rate(self, rate: float) -> None:
        """Set the speed of the simulation."""
        session = self._session
        if session.station is not None and not session.readonly:
            session.station.rate = rate
            session.rate = session.station.rate
        self._feed.changed(frozenset(("status",)))

    def change_rate(self, factor: float) -> None:
        """Change the speed of the simulation or of the shown recording by `factor`."""
        recording = self._session.recording
        if recording is not None:
            rate = recording.player.rate * factor
            recording.move(lambda player: setattr(player, "rate", rate))
        else:
            self.set_rate(next_rate(self._session.rate, factor))
