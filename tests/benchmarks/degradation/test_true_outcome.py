"""The scorer of benchmarks sees what the station cannot: a false "pass" and a broken rule."""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import cast

import pytest
from shapely import Polygon

from pa_console.schema.base import Point
from pa_console.schema.command import DeviceCommand, Verb
from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset
from pa_console.schema.mission import ActionOutcome, Decision, Metrics, Outcome, Verification
from pa_console.schema.telemetry import Picture
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import Site
from tests.benchmarks.degradation.true_outcome import RunResult, TruthWatch
from tests.mission.pictures import track


class Run:
    """A run whose station says what the test wants it to say."""

    def __init__(self, site: Site) -> None:
        self.sim = Checkpoint(site.world)
        self.watch = TruthWatch(site.world)
        self._count = 0
        self.picture()

    def tell(self, payload: ev.EventPayload) -> None:
        """Pass an event on to the watch."""
        event = ev.Event(t=datetime.now(UTC), tick=self.sim.tick, data=payload)
        self.watch.see(event, self.sim)

    def picture(self) -> None:
        """Report telemetry."""
        self.tell(ev.TelemetryReceived(picture=self.sim.picture()))

    def wait(self, seconds: float) -> None:
        """Let the world go on, telemetry twice a second."""
        for step in range(1, round(seconds * 10) + 1):
            self.sim.step()
            if step % 5 == 0:
                self.picture()

    def approve(self) -> None:
        """Let a plan be approved."""
        decision = Decision(kind="approve")
        self.tell(ev.DecisionMade(attempt=1, decision=decision, accepted=True))

    def send(self, agent: str, verb: Verb, target: str | None = None) -> None:
        """Send a command of the plan."""
        self._count += 1
        command = DeviceCommand(command_id=f"c{self._count}", agent=agent, verb=verb, target=target)
        self.sim.send(command)
        self.tell(ev.CommandSent(command=command))

    def claim(self, agent: str, command: str, outcome: Outcome = "pass") -> RunResult:
        """Let the station verify one action as of now, and say what the run came to."""
        action = ActionOutcome(agent=agent, command=command, outcome=outcome, reason="")
        verification = Verification(outcome=outcome, actions=(action,), as_of_s=self.sim.time_s)
        self.tell(ev.MissionVerified(verification=verification, seconds=0.0))
        self.wait(1.0)
        return self.watch.result()


@pytest.fixture
def run(site: Site) -> Run:
    return Run(site)


def test_an_honest_pass_is_believed(run: Run) -> None:
    run.approve()
    run.send("Drone_T04", "move_to", "WestGate")
    run.wait(15.0)
    result = run.claim("Drone_T04", "move_to WestGate")
    assert (result.passes, result.false_passes, result.broken) == (1, (), ())
    assert result.covered


@pytest.mark.parametrize(
    ("verb", "target"),
    [("move_to", "WestGate"), ("observe", "WestGate"), ("return_to_base", None)],
)
def test_a_pass_of_one_that_is_not_there_is_false(run: Run, verb: Verb, target: str | None) -> None:
    run.approve()
    run.send("Drone_T04", verb, target)
    run.wait(1.0)
    command = f"{verb} {target}" if target else verb
    assert run.claim("Drone_T04", command).false_passes == (
        f"Drone_T04 is not at {target or run.sim.world.base}",
    )


@pytest.mark.parametrize("outcome", ["fail", "unknown"])
def test_what_is_not_claimed_to_have_passed_is_no_lie(run: Run, outcome: Outcome) -> None:
    run.approve()
    run.send("Drone_T04", "move_to", "WestGate")
    result = run.claim("Drone_T04", "move_to WestGate", outcome)
    assert result.false_passes == ()
    assert (result.passes, result.fails, result.unknowns) == (
        0, outcome == "fail", outcome == "unknown",
    )  # fmt: skip


def test_a_pass_of_a_wreck_is_false(run: Run) -> None:
    run.approve()
    run.send("Drone_T04", "move_to", "WestGate")
    run.wait(15.0)
    run.sim.inject(FailAsset(asset="Drone_T04"))
    run.wait(1.0)
    assert run.claim("Drone_T04", "move_to WestGate").false_passes == (
        "Drone_T04 is not available",
    )


def test_a_pass_that_is_silent_about_a_gate_that_lost_its_cover_is_false(run: Run) -> None:
    run.approve()
    run.send("Drone_T04", "report")
    run.sim.inject(FailAsset(asset="Drone_T01"))
    run.wait(1.0)
    assert run.claim("Drone_T04", "report").false_passes == ("WestGate is not covered",)


def test_a_gate_that_was_bare_before_the_plan_is_not_the_plans_lie(run: Run) -> None:
    run.approve()
    run.send("Drone_T04", "hold")
    run.sim.inject(FailAsset(asset="Drone_T01"))
    run.wait(3.0)
    run.approve()
    run.send("Drone_T04", "report")
    run.wait(1.0)
    assert run.claim("Drone_T04", "report").false_passes == ()


def test_what_changes_just_after_it_was_verified_is_no_lie(run: Run) -> None:
    run.approve()
    run.send("Drone_T04", "move_to", "WestGate")
    run.wait(15.0)
    run.claim("Drone_T04", "move_to WestGate")
    run.send("Drone_T04", "return_to_base")
    run.wait(10.0)
    assert run.watch.result().false_passes == ()


def test_a_gate_left_alone_for_longer_than_the_grace_time_is_not_covered(run: Run) -> None:
    grace_s = run.sim.world.coverage_grace_s
    run.sim.inject(FailAsset(asset="Drone_T02"))
    run.wait(grace_s - 1.0)
    assert run.watch.result().covered
    run.wait(2.0)
    result = run.watch.result()
    assert not result.covered
    assert result.longest_gap_s == pytest.approx(grace_s + 1.0, abs=1.0)


@dataclass
class Posed:
    """A simulation whose truth is one posed picture."""

    picture: Picture

    def truth(self) -> Picture:
        """Return the pose."""
        return self.picture


def pose(run: Run, time_s: float, agent: str, at: Point, **contact: object) -> None:
    """Show the watch a truth in which `agent` stands at `at`, and a contact if one is described."""
    truth = run.sim.truth()
    asset = truth.assets[agent].model_copy(update={"position": at})
    tracks = {"T1": track("T1", "WestGate", **contact)} if contact else {}
    changes = {"time_s": time_s, "assets": truth.assets | {agent: asset}, "tracks": tracks}
    event = ev.Event(
        t=datetime.now(UTC), tick=0, data=ev.TelemetryReceived(picture=run.sim.picture())
    )
    run.watch.see(event, cast(Checkpoint, Posed(truth.model_copy(update=changes))))


@pytest.mark.parametrize(
    ("contact", "agent", "broken"),
    [
        ({"warned": False}, "Ugv_T02", ("ROE-04 Ugv_T02 T1",)),
        ({"warned": True}, "Ugv_T02", ()),
        ({"warned": False}, "Drone_T04", ()),
    ],
)
def test_a_ground_asset_that_closes_in_on_an_unwarned_contact_breaks_the_rule(
    run: Run, contact: dict[str, object], agent: str, broken: tuple[str, ...]
) -> None:
    run.send(agent, "move_to", "WestGate")
    for time_s, x in ((1.0, -20.0), (1.5, -22.0), (2.0, -24.0)):
        pose(run, time_s, agent, (x, 0.0), position=(-32.0, 0.0), **contact)
    assert run.watch.result().broken == broken


def test_a_contact_that_comes_closer_by_itself_is_nobodys_breach(run: Run) -> None:
    run.send("Ugv_T02", "move_to", "WestGate")
    for time_s, x in ((1.0, -32.0), (1.5, -28.0), (2.0, -24.0)):
        pose(run, time_s, "Ugv_T02", (-20.0, 0.0), position=(x, 0.0))
    assert run.watch.result().broken == ()


@pytest.mark.parametrize(
    ("intent", "broken"), [("unknown", ("ROE-07 Drone_T04 Depot",)), ("hostile", ())]
)
def test_the_restricted_zone_is_entered_only_with_a_confirmed_threat(
    run: Run, intent: str, broken: tuple[str, ...]
) -> None:
    depot = Polygon(run.sim.world.zones["Depot"].polygon).representative_point()
    run.send("Drone_T04", "move_to", "WestGate")
    for time_s, at in ((1.0, (0.0, 0.0)), (1.5, (depot.x, depot.y))):
        pose(run, time_s, "Drone_T04", at, intent=intent, identity="unauthorized")
    assert run.watch.result().broken == broken


def test_only_assets_under_orders_are_watched_at_the_perimeter(run: Run) -> None:
    for time_s, x in ((1.0, 0.0), (1.5, 500.0)):
        pose(run, time_s, "Drone_T04", (x, 0.0))
    assert run.watch.result().broken == ()
    run.send("Drone_T04", "move_to", "WestGate")
    pose(run, 2.0, "Drone_T04", (510.0, 0.0))
    assert run.watch.result().broken == ("ROE-06 Drone_T04",)


def test_missions_plans_halts_and_resends_are_counted(run: Run) -> None:
    run.approve()
    run.send("Drone_T04", "report")
    run.tell(ev.PlanHalted(attempt=1, reasons=("a premise broke",)))
    run.tell(ev.CommandResent(command_id="c1", times=1))
    run.approve()
    run.claim("Drone_T04", "report")
    finished = ev.MissionFinished(status="verified", reason="", metrics=Metrics())
    run.tell(finished)
    result = run.watch.result()
    assert (result.missions, result.plans, result.halts, result.resent) == (1, 2, 1, 1)
