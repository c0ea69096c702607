"""A false "pass" and a broken rule that the station does not see count in the result of a run."""

from datetime import UTC, datetime

import pytest

from pa_console.evaluation.run_facts import RuleBreach
from pa_console.schema.command import DeviceCommand, Verb
from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset
from pa_console.schema.mission import ActionOutcome, Decision, Metrics, Outcome, Verification
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import Site
from tests.benchmarks.degradation import true_outcome
from tests.benchmarks.degradation.true_outcome import RunResult, TruthWatch


class Run:
    """A run whose station says what the test wants it to say."""

    def __init__(self, site: Site) -> None:
        self.sim = Checkpoint(site.world)
        self.watch = TruthWatch(self.sim)
        self._count = 0
        self.picture()

    def tell(self, payload: ev.EventPayload) -> None:
        """Pass an event on to the watch."""
        event = ev.Event(t=datetime.now(UTC), tick=self.sim.tick, data=payload)
        self.watch.see(event)

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


def test_a_breach_that_the_strict_scorer_sees_is_in_the_result(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def find_breaches(*_: object) -> list[RuleBreach]:
        return [RuleBreach(rule_id="ROE-06", what="Drone_T04 left the perimeter", at_s=1.0)]

    monkeypatch.setattr(true_outcome, "find_breaches", find_breaches)
    assert run.watch.result().broken == ("ROE-06: Drone_T04 left the perimeter",)


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
