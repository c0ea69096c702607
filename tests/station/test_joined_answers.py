"""A console that has joined answers by itself; the station whose session it is hears nothing."""

from collections.abc import Sequence
from contextlib import aclosing
from types import SimpleNamespace
from typing import cast

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from pa_console.schema.events import event as ev
from pa_console.schema.plan import Plan
from pa_console.station.assembly import Site
from pa_console.station.joined_station import JoinedStation, Signatory
from pa_console.station.shared_log import SharedLog
from tests.scripted import ScriptedEngine, plan
from tests.station.test_answers import Talk, talks

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
    async def play(talk: Talk) -> None:
        await talk.order()
        joined = join(site, talk.events)
        for text in QUESTIONS:
            question = talk.station.question_in(text)
            assert question is not None
            assert joined.question_in(text) == question
            assert await joined.answer(question) == await talk.station.answer(question)

    await talks(site, play)


async def test_other_plans_stand_beside_the_one_that_waits_as_at_the_station(site: Site) -> None:
    robot = plan(("Robot_T01", "move_to EastGate"), reason="asked: 1 robot to EastGate; free")

    async def play(talk: Talk) -> None:
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

    await talks(site, play, engine=ScriptedEngine([robot]))


async def test_the_answer_is_shown_here_and_told_to_nobody_else(site: Site) -> None:
    async def play(talk: Talk) -> None:
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

    talk = await talks(site, play)
    assert "question_answered" not in [each.data.kind for each in talk.events]


async def test_what_takes_the_rules_in_force_there_is_asked_there(site: Site) -> None:
    async def play(talk: Talk) -> None:
        await talk.order()
        first = talk.events[0]
        assert isinstance(first.data, ev.SessionStarted)
        others = {"rules_sha256": "0" * 64, "rules_seal": None}
        started = first.model_copy(update={"data": first.data.model_copy(update=others)})
        joined = join(site, [started, *talk.events[1:]])
        for text in ("Why not Robot_T02?", "What would you do instead?"):
            (line,) = (await answered(joined, text)).lines
            assert line.about == "not here"
            assert "the rules in force there are not those that this console has" in line.said
            assert "ask it at north" in line.said
        said = [line.about for line in (await answered(joined, "Why?")).lines]
        assert {"read as", "checks", "rehearsal", "judge", "decision"} <= set(said)

    await talks(site, play)


async def test_what_is_no_question_is_commanded_there(site: Site) -> None:
    async def play(talk: Talk) -> None:
        joined = join(site, talk.events)
        assert joined.question_in("Send a drone to the east gate.") is None
        with pytest.raises(ValueError, match="the session of north: it is commanded there"):
            joined.submit("Send a drone to the east gate.")
        assert joined.question_in("why that one") is None
        joined.point("Drone_T04")
        assert joined.question_in("why that one") is not None

    await talks(site, play, engine=ScriptedEngine([plan()]))
