"""The simulated checkpoint, which has fixed time steps and a seed, and can be forked.

It depends on neither language models nor rules.
"""

import copy
import random
from collections.abc import Callable, Mapping
from typing import NamedTuple

from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.incident import Incident, Scenario
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.sim import (
    contacts,
    devices,
    forecast,
    incidents,
    motion,
    physics,
    radio,
    telemetry,
    truth,
)
from pa_console.sim import picture as station_side
from pa_console.sim.camera_view import still_of
from pa_console.sim.physics import Traffic
from pa_console.sim.scene import AssetState, RadioState, Report, Scene, settle_battery
from pa_console.sim.sensing import integrity
from pa_console.sim.sensing_state import Detection
from pa_console.sim.truth import TrueContact
from pa_console.sim.worlds.terrain import Terrain

LEAD_TICKS = 2


class StepMessages(NamedTuple):
    """The messages that reached the station in one step: reports, and detections of cameras."""

    reports: tuple[Report, ...] = ()
    wired: Mapping[str, tuple[Detection, ...]] | None = None
    """The detections of each camera; None in a step without a scan."""


class Checkpoint:
    """A simulated world; only `step()` advances it, by `world.dt_s`."""

    admit: devices.Admit | None = None
    """The check that devices make before they carry out a command; forks and forecasts have none.
    """

    def __init__(self, world: World, seed: int = 0, scenario: Scenario | None = None) -> None:
        """Start `world` with every asset at its post, with `scenario` if one is given.

        Raises ValueError if there is no place for an asset.
        """
        self.world, self.scenario = world, scenario
        self._terrain = Terrain.of(world)
        self._period = station_side.period_ticks(world)
        self.reset(seed)

    def reset(self, seed: int) -> None:
        """Start again at tick 0; equal seeds and equal inputs lead to equal states."""
        self.seed = seed
        self._scene = Scene(rng=random.Random(seed))
        self._traffic: Traffic | None = None
        nominal = RadioState.nominal(self.world.radio)
        for index, (name, spec) in enumerate(self.world.assets.items()):
            at = self.world.frames[spec.post].at
            asset = AssetState(
                name, spec.kind, index, *at, 0.0, spec.battery_pct, spec.post, at, nominal
            )
            incidents.place(self._terrain, self._scene, asset, spec.post)
            self._scene.assets[name] = asset
        self._scene.script = incidents.begin(self.scenario, seed)
        self._happened: list[Incident] = []
        self._skipped: list[str] = []
        self.arrived = StepMessages()
        self._play()
        self._show(station_side.begin(self._terrain, self._scene))

    @property
    def tick(self) -> int:
        """The number of steps since the last reset."""
        return self._scene.tick

    @property
    def time_s(self) -> float:
        """Simulated seconds since the last reset."""
        return self._terrain.seconds(self._scene.tick)

    def step(self) -> list[CommandReply]:
        """Advance by one `dt_s`; return the replies that arrived from devices during it."""
        terrain, scene, dt_s = self._terrain, self._scene, self.world.dt_s
        scene.tick += 1
        self._play()
        for command in radio.take_commands(scene):
            if command.agent in scene.assets:
                devices.note_heard(terrain, scene, scene.assets[command.agent])
            for reply in devices.accept(terrain, scene, command, self.admit):
                radio.send_reply(scene, reply, dt_s)
        busy = scene.busy()
        if busy:
            ground = self._traffic = self._traffic or motion.traffic(terrain, scene)
            velocities = motion.drive(terrain, scene, busy, ground, dt_s)
            physics.move(terrain, scene, ground, velocities, dt_s)
        contacts.advance(terrain, scene, dt_s)
        for asset in busy:
            asset.last_telemetry = None
            settle_battery(self.world, scene, asset)
            for reply in devices.work(terrain, scene, asset):
                radio.send_reply(scene, reply, dt_s)
            if scene.ideal:
                scene.touched.add(asset.id)
            if asset.command is None and not asset.route:
                scene.active.discard(asset.id)
        self._report()
        return radio.take_replies(scene)

    def send(self, command: DeviceCommand) -> None:
        """Put `command` on the link; the device receives it at the next step and answers.

        A command to an unknown agent is answered with `refused`; a command to an agent without a
        link gets no answer.
        """
        radio.send_command(self._scene, command, self.world.dt_s)

    def _report(self) -> None:
        """Send and receive heartbeats and reports; make a new picture if one is due.

        Reports are sent LEAD_TICKS before the picture is due, so that they arrive in time on an
        undisturbed link.
        """
        terrain, scene = self._terrain, self._scene
        phase = scene.tick % self._period
        wired: Mapping[str, tuple[Detection, ...]] | None = None
        if scene.ideal:
            if phase == 0:
                self._show(forecast.report(terrain, scene))
            return
        if phase == max(0, self._period - LEAD_TICKS) % self._period:
            radio.end_jams(scene)
            devices.listen(terrain, scene)
            wired = telemetry.send(terrain, scene)
        reports = radio.take_reports(scene)
        self.arrived = StepMessages(tuple(reports), wired)
        station_side.receive(terrain, scene, reports)
        if phase == 0:
            integrity.compare(terrain, scene)
            self._show(station_side.build(terrain, scene, scene.assets))

    def inject(self, incident: Incident) -> None:
        """Apply `incident` now; it appears in the picture once telemetry reports it.

        An incident before the first step is part of the set-up, so the picture shows it from the
        start. Raises ValueError, with the valid names, for an unknown asset, gate or frame, for a
        track at a gate without a lane, and for a frame without a free place.
        """
        incidents.apply(self._terrain, self._scene, incident)
        self._traffic = None
        if self.tick == 0:
            self._show(station_side.begin(self._terrain, self._scene))

    def mark_manual(self, assets: frozenset[str]) -> None:
        """Set the assets that the station records as under manual control; update the picture."""
        station = self._scene.station
        changed = station.manual ^ assets
        station.manual = assets
        if changed:
            self._show(station_side.build(self._terrain, self._scene, changed))

    def picture(self) -> Picture:
        """Return the picture from the last reports; `world.telemetry_period_s` is its period."""
        if self._picture is None:
            assert self._draft is not None
            self._picture = self._draft.picture()
        return self._picture

    def _show(self, draft: station_side.Draft) -> None:
        """Set the current picture; it is assembled when it is read."""
        self._draft: station_side.Draft | None = draft
        self._picture: Picture | None = None

    def truth(self) -> Picture:
        """Return the exact state, for tests, scorers and benchmarks only.

        A contact has the id of its track if the station tracks it, otherwise its own id.
        """
        return truth.truth(self._terrain, self._scene)

    def true_contacts(self) -> tuple[TrueContact, ...]:
        """Return the exact state of vehicles and persons, by ids that never change, for scorers."""
        return truth.true_contacts(self._terrain, self._scene)

    def still(self, camera: str, track: str) -> Callable[[], bytes] | None:
        """Return a function that draws the camera's image of `track`; None if there is no image."""
        return still_of(self._terrain, self._scene, self.seed, camera, track)

    def forecast(self) -> "Checkpoint":
        """Return a simulation built from the picture and the world alone."""
        return self.ahead_of(self._terrain, self.picture())

    @staticmethod
    def ahead_of(terrain: Terrain, picture: Picture) -> "Checkpoint":
        """Return a simulation of `picture` on `terrain`; the picture may come from any source."""
        twin = Checkpoint.__new__(Checkpoint)
        twin.world, twin.seed, twin.scenario = terrain.world, 0, None
        twin._happened, twin._skipped, twin.arrived = [], [], StepMessages()
        twin._terrain, twin._traffic = terrain, None
        twin._period = station_side.period_ticks(terrain.world)
        twin._draft, twin._picture = None, picture
        twin._scene = forecast.scene_of(terrain, picture)
        return twin

    def take_incidents(self) -> list[Incident]:
        """Return the incidents that the scenario has caused since the last call, for the log."""
        taken, self._happened = self._happened, []
        return taken

    def take_skipped(self) -> list[str]:
        """Return a sentence for each incident that could not happen since the last call."""
        taken, self._skipped = self._skipped, []
        return taken

    def _play(self) -> None:
        """Apply the scenario's events of this tick."""
        if self.scenario is not None:
            done, skipped = incidents.play(self._terrain, self._scene, self.scenario)
            self._happened += done
            self._skipped += skipped
            if done:
                self._traffic = None

    def fork(self) -> "Checkpoint":
        """Return an independent copy; with equal inputs, it stays equal to the original."""
        twin = copy.copy(self)
        twin.admit, twin._traffic = None, None
        twin._happened, twin._skipped = list(self._happened), list(self._skipped)
        twin._scene = self._scene.copy()
        return twin

    def state_hash(self) -> str:
        """Return the SHA-256 of the whole dynamic state."""
        return self._scene.digest()
