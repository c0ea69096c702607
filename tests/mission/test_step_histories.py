"""Thousands of random histories of plans in steps: what waits, fails, is stopped, is rejected."""

import asyncio
from collections.abc import Iterable
from random import Random
from types import SimpleNamespace
from typing import Any, cast

import pytest

from pa_console.mission.context import MissionResult
from pa_console.mission.examine import Examination
from pa_console.mission.execute import ApprovedStep, ExecutedPlan
from pa_console.mission.rehearse import device_commands
from pa_console.mission.report import ReportFacts
from pa_console.mission.sequences import step_by_step
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import ActionOutcome, Decision, Verification
from pa_console.schema.plan import Action, Plan
from tests.mission.gate import Link, gate_on

RULES = Rulebook("none", "", ())
HISTORIES = 1600
NAMES = ("Drone_T04", "Robot_T01", "Robot_T02", "Ugv_T02")
GATES = ("NorthGate", "EastGate", "SouthGate", "WestGate")


def drawn_plan(random: Random) -> Plan:
    """Return a plan whose actions wait for some of those before them."""
    count = random.randint(2, 6)
    actions = [
        Action(
            agent=random.choice(NAMES),
            command=f"move_to {random.choice(GATES)}",
            after=tuple(sorted(random.sample(range(1, at + 1), random.randint(0, min(at, 2))))),
            stay_s=random.choice((0.0, 0.0, 5.0)),
        )
        for at in range(count)
    ]
    return Plan(reason="drawn", actions=tuple(actions))


def request(plan: Plan, number: int = 1) -> ev.ApprovalRequested:
    """Return the request to approve `plan`."""
    return ev.ApprovalRequested(request_id=f"M1.{number}", attempt=number, plan=plan)


class Steps:
    """The steps of one plan with outcomes that are drawn: halts, doubts, rules broken by then."""

    def __init__(self, random: Random) -> None:
        self.random, self.link = random, Link()
        self.gate, self.plan = gate_on(self.link), drawn_plan(random)
        self.asked = request(self.plan)
        self.shown = Examination(self.plan, (), None, 0.0, 0.0)
        self.events: list[ev.EventPayload] = []
        self.verified, self.sent = set[int](), set[int]()
        self.stopped = False
        self.gate.grant(self.asked, Decision(kind="approve"), RULES)

    async def safeguards(self, _context: object, _task: object, part: Plan) -> Examination:
        """Examine a step at its moment."""
        broken = Finding(
            rule_id="WF-03", priority="critical", status="violates", message="no guard is left"
        )
        found = (broken,) if self.random.random() < 0.1 else ()
        return Examination(part, found, None, 0.0, 0.0)

    async def run(self, step: ApprovedStep) -> ExecutedPlan:
        """Send a step; it may be halted, or everything may be stopped meanwhile."""
        for number in step.numbers:
            assert set(self.plan.actions[number - 1].after) <= self.verified
            assert number not in self.sent, "none twice"
        before = len(self.link.sent)
        self.gate.send(step.commands, lambda _: None)
        if len(self.link.sent) > before:
            assert not self.stopped, "none after a stop"
            self.sent |= {*step.numbers}
        if self.random.random() < 0.05:
            self.gate.stop_all()
            self.stopped = True
            raise asyncio.CancelledError
        if self.random.random() < 0.1:
            self.gate.halt()
            return ExecutedPlan(cast(Any, None), halted=("Drone_T04 failed on its way",))
        return ExecutedPlan(cast(Any, None))

    async def stay(self, seconds: float) -> None:
        """Let time pass."""
        assert seconds > 0.0

    def verify(
        self, _context: object, part: Plan, _executed: object, position: int
    ) -> Verification:
        """Return what telemetry says of a step."""
        lost = ("NorthGate",) if self.random.random() < 0.05 else ()
        outcomes = tuple(
            ActionOutcome(
                agent=action.agent,
                command=action.command,
                outcome=self.random.choices(("pass", "unknown", "fail"), (85, 8, 7))[0],
                reason="drawn",
            )
            for action in part.actions
        )
        whole = "pass" if not lost and all(o.outcome == "pass" for o in outcomes) else "fail"
        if not lost:
            due = [n for n in self.plan.steps[position - 1] if n in self.sent]
            passed = zip(due, outcomes, strict=True)
            self.verified |= {n for n, one in passed if one.outcome == "pass"}
        return Verification(outcome=whole, actions=outcomes, gates_lost=lost, reason="drawn")

    def carry_out(self, patch: pytest.MonkeyPatch) -> MissionResult | None:
        """Carry the plan out and return what it comes to."""
        patch.setattr(step_by_step, "safeguards", self.safeguards)
        patch.setattr(step_by_step, "verify", self.verify)
        services = SimpleNamespace(gate=self.gate)
        approved = SimpleNamespace(
            planned=SimpleNamespace(best=SimpleNamespace(examination=self.shown, unmet=())),
            decided=SimpleNamespace(request=self.asked, decision=Decision(kind="approve")),
        )
        context = SimpleNamespace(services=services, emit=self.events.append)
        task = SimpleNamespace(text="drawn")
        facts = ReportFacts(cast(Any, None))
        results = SimpleNamespace(verifications=[])

        async def run() -> MissionResult | None:
            goes_on = asyncio.Event()
            goes_on.set()
            parts = (context, self, approved, task, results, facts, goes_on)
            return await step_by_step.StepByStep(*cast(Any, parts)).run()

        return asyncio.run(run())

    @property
    def held(self) -> Iterable[str]:
        """What an event says that it was not sent."""
        held = (event for event in self.events if isinstance(event, ev.StepsHeld))
        return [order for event in held for order in event.orders]


@pytest.mark.parametrize("seed", range(4))
def test_no_step_is_lost_in_silence(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    random = Random(seed)
    for _ in range(HISTORIES // 4):
        steps = Steps(random)
        try:
            result = steps.carry_out(monkeypatch)
        except asyncio.CancelledError:
            steps.gate.send(device_commands(steps.plan, "M1.1"), lambda _: None)
            assert len(steps.link.sent) == len(steps.sent), "none after a stop"
            continue
        unsent = [
            f"{action.agent} {action.command}"
            for number, action in enumerate(steps.plan.actions, start=1)
            if number not in steps.sent
        ]
        assert sorted(steps.held) == sorted(unsent), "each is sent, or an event names it"
        done = len(steps.verified) == len(steps.plan.actions)
        assert (result is None) == done
        if unsent:
            assert result is not None
            assert "not sent: " in result.reason
