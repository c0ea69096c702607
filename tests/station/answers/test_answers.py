"""Questions are answered from the record and by checks; nothing is decided and nobody moves."""

import random
from collections.abc import AsyncGenerator, Sequence
from contextlib import aclosing, asynccontextmanager
from types import SimpleNamespace
from typing import cast

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from pa_console.fleets.simulated import SimulatedFleet
from pa_console.mission.approval import standing_approver
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.incident import FailAsset, Incident, SetBattery
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Plan
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.joined.joined_station import JoinedStation, Signatory
from pa_console.station.joined.shared_log import SharedLog
from tests.scripted import FAILURE, SUCCESS, ScriptedEngine, plan

REASON = "asked: 1 drone to EastGate; Drone_T04 is free"
TO_EAST = plan(("Drone_T04", "move_to EastGate"), reason=REASON)
ORDER = "Send a drone to the east gate."


class SpiedFleet(SimulatedFleet):
    """Counts what goes to devices."""

    sent = 0

    def send(self, command: DeviceCommand) -> None:
        """Count a command, and send it."""
        self.sent += 1
        super().send(command)


class Talk:
    """A session in which orders are given, questions are asked and plans are decided, in turn."""

    def __init__(self, site: Site, engine: ScriptedEngine, setup: Sequence[Incident] = ()) -> None:
        self.fleet = SpiedFleet(Checkpoint(site.world, 0))
        self.engine = engine
        for incident in setup:
            self.fleet.inject(incident)
        self.station = open_station(site, engine.engine(), SteppedClock(), fleet=self.fleet)
        self.events: list[ev.Event] = []
        self.stream: AsyncGenerator[ev.Event] = self.station.run()

    async def until(self, *kinds: str) -> ev.Event:
        """Follow the session up to the next event of one of `kinds`."""
        async for event in self.stream:
            self.events.append(event)
            if event.data.kind in kinds:
                return event
        raise AssertionError(f"the session ended before {kinds}")

    async def ask(self, text: str) -> dict[str, str]:
        """Return the answer by what its lines are about, those about the same joined."""
        question = self.station.question_in(text)
        assert question is not None, text
        told = await self.station.answer(question)
        said: dict[str, str] = {}
        for line in told.lines:
            before = f"{said[line.about]}; " if line.about in said else ""
            said[line.about] = before + line.said
        return said

    async def order(self, text: str = ORDER) -> ev.ApprovalRequested:
        """Give an order, and return the request that its plan leads to."""
        self.station.submit(text)
        event = await self.until("approval_requested")
        assert isinstance(event.data, ev.ApprovalRequested)
        return event.data

    async def decide(self, request: ev.ApprovalRequested, **decision: object) -> None:
        """Decide about the plan that waits, as the standing approver does unless told."""
        given = (
            Decision.model_validate(decision) if decision else standing_approver("auto")(request)
        )
        self.station.decide(given.model_copy(update={"request_id": request.request_id}))
        await self.until("mission_finished")
        await self.station.settled()


@asynccontextmanager
async def talks(
    site: Site, *setup: Incident, engine: ScriptedEngine | None = None
) -> AsyncGenerator[Talk]:
    """Give a session on the checkpoint some seconds after `setup`."""
    talk = Talk(site, engine or ScriptedEngine([TO_EAST]), setup)
    async with aclosing(talk.stream):
        await talk.until("telemetry")
        await talk.station.advance(3.0)
        yield talk


async def test_before_anything_is_ordered_there_is_nothing_to_tell(site: Site) -> None:
    async with talks(site) as talk:
        for text in ("Why?", "why that drone", "why not the robot", "any other option?"):
            assert list(await talk.ask(text)) == ["on record"]


async def test_why_tells_reading_rules_asset_checks_judge_and_decision(site: Site) -> None:
    async with talks(site) as talk:
        request = await talk.order()
        said = await talk.ask("Why?")
        assert ORDER in said["order"]
        assert said["read as"] == "send 1 drone to EastGate"
        assert "ROE-01" in said["rules"]
        assert "nearest free drone" in said["Drone_T04"]
        assert "no rule is broken" in said["checks"]
        assert "every gate kept its guard" in said["rehearsal"]
        assert said["judge"] == "does not object"
        assert "waits for the operator" in said["decision"]
        await talk.decide(request)
        said = await talk.ask("Why?")
        assert "approved by" in said["decision"]
        assert said["outcome"].startswith("verified")


@pytest.mark.parametrize(
    ("name", "against"),
    [
        ("Drone_T02", "it alone covers NorthGate"),
        ("Drone_T02", "WF-03"),
        ("Ugv_T02", "read as asking for a drone"),
        ("Robot_T01", "has failed"),
        ("Robot_T02", "its battery is low"),
        ("Robot_T02", "it arrives after"),
        ("Drone_T04", "it is in the plan: move_to EastGate"),
    ],
)
async def test_why_not_names_what_really_stands_against_an_asset(
    site: Site, name: str, against: str
) -> None:
    setup = (FailAsset(asset="Robot_T01"), SetBattery(asset="Robot_T02", percent=20.0))
    async with talks(site, *setup) as talk:
        await talk.order()
        assert against in (await talk.ask(f"Why not {name}?"))[name]


async def test_an_asset_that_cannot_do_it_is_told_so(site: Site) -> None:
    look = plan(("Drone_T04", "observe EastGate"), reason="asked: 1 drone looks at EastGate; so")

    async with talks(site, engine=ScriptedEngine([look])) as talk:
        await talk.order("Look at the east gate.")
        assert (await talk.ask("Why not Robot_T01?"))["Robot_T01"] == "only a drone can observe"


async def test_who_has_no_part_in_the_plan_is_given_no_reason(site: Site) -> None:
    async with talks(site) as talk:
        await talk.order()
        said = await talk.ask("Why Robot_T01?")
        assert "has no part in the plan" in said["plan"]
        assert "Drone_T04" in said["plan"]


async def test_a_nearer_asset_that_was_free_is_told_without_a_reason(site: Site) -> None:
    far = plan(("Ugv_T02", "move_to NorthGate"), reason="asked: 1 asset to NorthGate; free")

    async with talks(site, engine=ScriptedEngine([far])) as talk:
        await talk.order("Somebody to the north gate.")
        said = (await talk.ask("Why Ugv_T02?"))["Ugv_T02"]
        assert "the record has no reason why" in said or "nearest free" in said


async def test_an_asset_that_could_not_have_been_taken_is_not_named_as_nearer(site: Site) -> None:
    """Robot_T02 is nearer to the gate than the drone, but a drone was asked for."""
    sent = plan(("Drone_T04", "move_to EastGate"), reason="Drone_T04 is free")

    async with talks(site, engine=ScriptedEngine([sent])) as talk:
        await talk.order("Have a drone stand by in the east.")
        said = (await talk.ask("Why Drone_T04?"))["Drone_T04"]
        assert "nearest free drone" in said
        assert "Robot_T02" not in said


async def test_the_judge_s_objection_and_a_rejection_are_told(site: Site) -> None:
    async with talks(site, engine=ScriptedEngine([TO_EAST], [FAILURE])) as talk:
        request = await talk.order()
        assert "wrong gate" in (await talk.ask("Why?"))["judge"]
        await talk.decide(request, kind="reject", reason="not now")
        said = await talk.ask("Why?")
        assert "rejected by operator: not now" in said["decision"]
        assert said["outcome"] == "rejected: not now"


async def test_an_order_that_the_rules_refuse_is_told_with_its_rule(site: Site) -> None:
    async with talks(site) as talk:
        talk.station.submit("Shoot the vehicle at the west gate.")
        await talk.until("mission_finished")
        said = await talk.ask("Why was it refused?")
        assert "ROE-01" in said["checks"]
        assert said["outcome"].startswith("refused")
        assert (await talk.ask("why not the robot")).keys() >= {"outcome"}


async def test_what_was_asked_back_is_told(site: Site) -> None:
    async with talks(site) as talk:
        request = await talk.order("Send a drone to the gate with two guards.")
        assert request.state == "not_understood"
        assert "fits" in (await talk.ask("Why?"))["asked back"]


async def test_a_reference_is_told_with_what_it_means(site: Site) -> None:
    back = plan(("Drone_T04", "move_to Checkpoint"), reason="asked: Drone_T04 to Checkpoint; up")

    async with talks(site, engine=ScriptedEngine([TO_EAST, back])) as talk:
        await talk.decide(await talk.order())
        await talk.order("Bring it back.")
        said = await talk.ask("Why?")
        assert "Drone_T04" in said["put in full"]


async def test_why_a_gate_is_bare_names_since_when_and_who_failed(site: Site) -> None:
    async with talks(site) as talk:
        talk.station.inject(FailAsset(asset="Drone_T02"))
        await talk.station.advance(4.0)
        said = await talk.ask("Why is nobody at the north gate?")
        assert said["now"] == "no asset covers NorthGate"
        assert "no guard for" in said["since"]
        assert "failed" in said["Drone_T02"]
        assert "no longer covered" in said["told"]
        assert "is covered" in (await talk.ask("Why is the east gate uncovered?"))["now"]


async def test_why_a_gate_is_bare_names_the_mission_that_sent_its_guard_away(site: Site) -> None:
    back = plan(("Drone_T04", "move_to Checkpoint"), reason="asked: Drone_T04 to Checkpoint; up")
    async with talks(site, engine=ScriptedEngine([TO_EAST, back])) as talk:
        await talk.decide(await talk.order("Send Drone_T04 to the east gate."))
        said = await talk.ask("Why is the east gate uncovered?")
        assert "is covered" in said["now"]
        await talk.decide(await talk.order("Send Drone_T04 to the checkpoint."))
        said = await talk.ask("Why did you leave the east gate unguarded?")
        assert "sent it away: move_to Checkpoint, approved by" in said["Drone_T04"]


async def test_other_plans_are_rehearsed_and_none_is_to_do_nothing(site: Site) -> None:
    anybody = plan(("Robot_T01", "move_to EastGate"), reason="asked: 1 robot to EastGate; free")

    async with talks(site, engine=ScriptedEngine([anybody])) as talk:
        await talk.order("Send a robot to the east gate.")
        said = await talk.ask("What would you do instead?")
        assert "move_to EastGate" in said["another way"]
        assert "over after" in said["another way"]
        assert " hold" not in said["another way"]
        assert len(talk.engine.requests) == 2, "one plan and one verdict, no model for the question"


async def test_where_nothing_waits_other_plans_are_for_the_present_picture(site: Site) -> None:
    robot = plan(("Robot_T01", "move_to EastGate"), reason="asked: 1 robot to EastGate; free")

    async with talks(site, engine=ScriptedEngine([robot])) as talk:
        await talk.decide(await talk.order("Send a robot to the east gate."))
        sent = talk.fleet.sent
        said = await talk.ask("What else could we do?")
        assert "found in the current picture" in said["now"]
        assert "Robot_T02 move_to EastGate" in said["another way"]
        assert talk.fleet.sent == sent == 1


async def test_a_question_is_no_mission(site: Site) -> None:
    async with talks(site) as talk:
        with pytest.raises(ValueError, match="question"):
            talk.station.submit("Why?")
        assert talk.station.question_in("Why is nobody at the north gate? Send someone.") is None
    assert not [each for each in talk.events if each.data.kind == "mission_received"]


FORMS = (
    *("Why?", "how come", "Why was it refused?", "What would you do instead?", "any other option?"),
    *("Why {asset}?", "Why did you send {asset}?", "why did you not send {asset} there"),
    *("Why is nobody at {gate}?", "Why is {gate} uncovered?", "why that drone", "Explain."),
)
COSTLY = ("Why not {asset}?", "why not the robot", "What speaks against {asset}?")


@pytest.mark.long
async def test_hundreds_of_questions_move_nobody_and_decide_nothing(site: Site) -> None:
    """At each moment of a session with orders, refusals, a stop and a question back."""
    rng = random.Random(0)
    asked = 0

    async def questions(talk: Talk, number: int) -> None:
        nonlocal asked
        waits = talk.station.awaits_decision
        sent, requests = talk.fleet.sent, len(talk.engine.requests)
        for count in range(number):
            form = rng.choice(COSTLY if count % 40 == 0 else FORMS)
            name, gate = rng.choice([*site.world.assets]), rng.choice(site.world.gates)
            question = talk.station.question_in(form.format(asset=name, gate=gate))
            assert question is not None
            told = await talk.station.answer(question)
            assert told.lines
            asked += 1
        assert talk.fleet.sent == sent
        assert talk.station.awaits_decision == waits
        assert len(talk.engine.requests) == requests, "no model is asked"

    async with talks(site, engine=ScriptedEngine([TO_EAST], [SUCCESS])) as talk:
        await questions(talk, 50)
        request = await talk.order()
        await questions(talk, 125)
        await talk.decide(request)
        await questions(talk, 125)
        talk.station.submit("Shoot the vehicle at the west gate.")
        await talk.until("mission_finished")
        await questions(talk, 75)
        asked_back = await talk.order("Send a drone to the gate with two guards.")
        await questions(talk, 75)
        await talk.decide(asked_back, kind="reject", reason="never mind")
        talk.station.stop_all()
        await questions(talk, 50)
    assert asked == 500
    answered = [each for each in talk.events if each.data.kind == "question_answered"]
    assert answered


QUESTIONS = (
    *("Why?", "Why Drone_T04?", "Why not Drone_T02?", "why not the robot"),
    *("Why is nobody at the west gate?", "What would you do instead?"),
)


class NorthLog:
    """The log of north: nothing more comes, and nothing must be published."""

    def __init__(self) -> None:
        self.problem = ""
        self.stream = SimpleNamespace(station="north", missing=0)
        self.link = SimpleNamespace(problem="")
        self.trust = SimpleNamespace(takeover=None)

    def take(self) -> list[ev.Event]:
        """Return nothing more."""
        return []

    def publish(self, *_: object) -> bool:
        """Fail: an answer is told to nobody else."""
        raise AssertionError("nothing is sent to the station for a question")


def join(site: Site, events: Sequence[ev.Event]) -> JoinedStation:
    """Return a console that has joined a session in which so much has happened."""
    log = cast(SharedLog, NorthLog())
    signatory = Signatory("bob", Ed25519PrivateKey.generate())
    return JoinedStation(log, events, signatory, site.world, site.rulebook)


async def answered(joined: JoinedStation, text: str) -> ev.QuestionAnswered:
    question = joined.question_in(text)
    assert question is not None, text
    return await joined.answer(question)


async def test_it_answers_as_the_station_does(site: Site) -> None:
    async with talks(site) as talk:
        await talk.order()
        joined = join(site, talk.events)
        for text in QUESTIONS:
            question = talk.station.question_in(text)
            assert question is not None
            assert joined.question_in(text) == question
            assert await joined.answer(question) == await talk.station.answer(question)


async def test_other_plans_stand_beside_the_one_that_waits_as_at_the_station(site: Site) -> None:
    robot = plan(("Robot_T01", "move_to EastGate"), reason="asked: 1 robot to EastGate; free")

    async with talks(site, engine=ScriptedEngine([robot])) as talk:
        request = await talk.order("Send a robot to the east gate.")
        joined = join(site, talk.events)
        (mission,) = [e.data.mission for e in talk.events if isinstance(e.data, ev.MissionReceived)]
        asked = "asked: 1 robot to EastGate"
        found: list[list[Plan]] = []
        for station in (talk.station, joined):
            ways = station.other_ways(mission, asked, request.plan)
            read = await station.look_at(mission, asked)
            assert read is not None
            found.append([read.plan, *[each.plan async for each in ways]])
        assert found[0] == found[1]
        assert len(found[0]) > 1


async def test_the_answer_is_shown_here_and_told_to_nobody_else(site: Site) -> None:
    async with talks(site) as talk:
        request = await talk.order()
        joined = join(site, talk.events)
        told = await answered(joined, "Why not Robot_T02?")
        shown: list[ev.Event] = []
        async with aclosing(joined.run()) as events:
            async for event in events:
                shown.append(event)
                if event.data.kind == "question_answered":
                    break
        assert shown[-1].data == told
        assert shown[-1].mission == talk.events[-1].mission
        assert talk.station.awaits_decision
        await talk.decide(request)
    assert "question_answered" not in [each.data.kind for each in talk.events]


async def test_what_takes_the_rules_in_force_there_is_asked_there(site: Site) -> None:
    async with talks(site) as talk:
        await talk.order()
        first = talk.events[0]
        assert isinstance(first.data, ev.SessionStarted)
        others = {"rules_sha256": "0" * 64, "rules_seal": None}
        started = first.model_copy(update={"data": first.data.model_copy(update=others)})
        joined = join(site, [started, *talk.events[1:]])
        for text in ("Why not Robot_T02?", "What would you do instead?"):
            (line,) = (await answered(joined, text)).lines
            assert line.about == "not here"
            assert (
                "the rules in force at the station differ from those of this console" in line.said
            )
            assert "ask it at north" in line.said
        said = [line.about for line in (await answered(joined, "Why?")).lines]
        assert {"read as", "checks", "rehearsal", "judge", "decision"} <= set(said)


async def test_what_is_no_question_is_commanded_there(site: Site) -> None:
    async with talks(site, engine=ScriptedEngine([plan()])) as talk:
        joined = join(site, talk.events)
        assert joined.question_in("Send a drone to the east gate.") is None
        with pytest.raises(ValueError, match="the session of north, which is in command"):
            joined.submit("Send a drone to the east gate.")
        assert joined.question_in("why that one") is None
        joined.point("Drone_T04")
        assert joined.question_in("why that one") is not None
