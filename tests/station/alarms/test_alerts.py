"""People are told of what needs them, once, again when nobody acts, and not too often."""

from collections.abc import Sequence
from queue import Queue

import pytest

from pa_console.schema.base import AlarmPriority
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Alarm
from pa_console.station.alarms.alerts import Alerting, AlertRules, Message
from tests.session.story import at
from tests.tui import story

MINUTE = 60.0


def raised(name: str, priority: AlarmPriority = "high") -> ev.AlarmRaised:
    text = f"{name} is near"
    alarm = Alarm(
        id=name, kind="unknown_track", priority=priority, subject=name, text=text, raised_s=1.0
    )
    return ev.AlarmRaised(alarm=alarm)


class Told:
    """The messages that rules give for events at times of the test's own."""

    def __init__(self, lowest: AlarmPriority = "high", after_s: float = 5 * MINUTE) -> None:
        self.rules = AlertRules(lowest, after_s)

    def of(self, now_s: float, *payloads: ev.EventPayload) -> list[Message]:
        """Return what is told at a time at which this happens."""
        for payload in payloads:
            self.rules.take(at(0, payload), now_s)
        return self.rules.due(now_s)


def test_an_alarm_of_enough_priority_is_told_at_once_and_once() -> None:
    told = Told("high")
    assert told.of(0.0, raised("Track_01", "medium")) == []
    [message] = told.of(1.0, raised("Track_02", "emergency"))
    assert message.title == "PA Console: emergency alarm: Track_02"
    assert message.body == "emergency alarm: Track_02. Track_02 is near"
    assert not message.later
    assert told.of(2.0, raised("Track_02", "emergency")) == []


def test_nobody_acts_is_told_to_more_people_and_then_less_and_less_often() -> None:
    told = Told()
    told.of(0.0, raised("Track_01"))
    assert told.rules.next_s(0.0) == 5 * MINUTE
    late = [minute for minute in range(1, 40) if any(m.later for m in told.of(minute * MINUTE))]
    assert late == [5, 15, 35]
    [message] = told.of(75 * MINUTE)
    assert message.title == "PA Console: NOBODY ACTS, high alarm: Track_01"
    assert "for 75 min" in message.body


@pytest.mark.parametrize(
    "act",
    [
        ev.AlarmAcknowledged(alarm_id="Track_01"),
        ev.AlarmCleared(alarm_id="Track_01", reason="gone"),
    ],
)
def test_who_acts_is_left_alone(act: ev.EventPayload) -> None:
    told = Told()
    told.of(0.0, raised("Track_01"))
    told.of(MINUTE, act)
    assert told.of(60 * MINUTE) == []


def test_a_plan_that_waits_is_told_when_nobody_decides() -> None:
    told = Told()
    for event in story.stamped(story.told("approval")):
        told.rules.take(event, 0.0)
    assert all(not message.later for message in told.of(1.0))
    [message] = told.of(5 * MINUTE)
    assert f"plan of {story.MISSION.id} waits, for 5 min" in message.body
    for event in story.stamped(story.told("executing")):
        told.rules.take(event, 6 * MINUTE)
    assert told.of(60 * MINUTE) == []


def test_an_alarm_that_comes_and_goes_is_not_told_each_time() -> None:
    told = Told(after_s=0.0)
    gone = ev.AlarmCleared(alarm_id="Track_01", reason="gone")
    messages = [m for s in range(60) for m in told.of(float(s), raised("Track_01"), gone)]
    assert len(messages) == 1
    assert len(told.of(11 * MINUTE, raised("Track_01"))) == 1


def test_a_flood_is_few_messages_and_an_emergency_goes_all_the_same() -> None:
    told = Told(after_s=0.0)
    sent = [m for s in range(40) for m in told.of(float(s), raised(f"Track_{s:02}"))]
    assert len(sent) == 10
    [urgent] = told.of(50.0, raised("Track_99", "emergency"))
    assert "emergency alarm: Track_99" in urgent.title
    assert "and 23 more" in urgent.body, "what was held back is told with it"
    assert told.of(51.0) == []


def test_alerts_that_break_down_are_told_of() -> None:
    class Broken:
        def give(self, message: Message) -> None:
            raise OSError("no more threads")

        def news(self) -> Sequence[str]:
            return []

    with Alerting(AlertRules("high", 0.0), Broken()) as alerts:
        alerts.take(at(0, raised("Track_01")))
    [notice] = alerts.news()
    assert isinstance(notice, ev.Noticed)
    assert (notice.level, notice.text) == (
        "warning",
        "people are not told any more: OSError: no more threads",
    )


def test_the_station_waits_for_nothing_and_hears_what_became_of_a_message() -> None:
    given: Queue[Message] = Queue()

    class Delivered:
        def give(self, message: Message) -> None:
            given.put(message)

        def news(self) -> Sequence[str]:
            return ["receiver 1 (Slack) not told, no answer within 10 s: x"]

    with Alerting(AlertRules("high", 0.0), Delivered()) as alerts:
        alerts.take(at(0, raised("Track_01")))
        assert given.get(timeout=5).title == "PA Console: high alarm: Track_01"
        [notice] = alerts.news()
    assert isinstance(notice, ev.Noticed)
    assert notice.level == "warning"
    assert "receiver 1 (Slack) not told" in notice.text
