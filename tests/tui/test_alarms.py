"""Alarms and the queue: always in sight, acknowledged and reordered from the keyboard."""

import pytest

from pa_console.schema.events import event as ev
from pa_console.tui.actions import ACTIONS, ActionContext
from pa_console.tui.widgets.alarms import AlarmBar, AlarmPane, summary
from pa_console.tui.widgets.mission_prompt import MissionInput, MissionPrompt
from pa_console.tui.widgets.row_views import EventList
from tests.tui import living, story
from tests.tui.scripted import ScriptedStation, Show, notices, press, settle
from tests.tui.test_mission import shown

SIZE = (120, 36)
SMALL = (80, 24)
QUEUE_KEYS = ("u", "d", "z", "x")


@pytest.mark.parametrize("width", [60, 80, 120])
def test_the_count_the_worst_alarm_and_the_queue_are_always_named(width: int) -> None:
    text = summary(story.folded(living.alarmed()), width).plain
    for words in ("■ 3 alarms, 2 NEW", "EMERGENCY", "queue 2"):
        assert words in text
    assert len(text) <= width
    assert "fog" in text


def test_without_alarms_the_bar_says_so() -> None:
    text = summary(story.folded(story.opening()), 80).plain
    assert "no alarm" in text
    assert "clear" in text


async def test_acknowledge_takes_the_worst_new_alarm_then_the_next(show: Show) -> None:
    async with show(living.alarmed()) as (app, pilot, station, _):
        await press(pilot, "escape", "k", "enter")
        await press(pilot, "k", "enter")
        assert station.acknowledged == [living.HOSTILE.id, living.UNKNOWN.id]
        await pilot.press("k", "enter")
        assert len(station.acknowledged) == 2
        assert "NEW" not in str(app.screen.query_one(AlarmBar).render())


async def test_a_new_emergency_does_not_take_the_pointer_from_the_operator(show: Show) -> None:
    async with show([*living.troubled()[:-2], ev.AlarmAcknowledged(alarm_id="x")]) as (
        app,
        pilot,
        station,
        _,
    ):
        await pilot.press("escape", "j")
        before = app.screen.query_one(AlarmPane).cursor
        station.emit(ev.AlarmRaised(alarm=living.HOSTILE), mission=None)
        await settle(pilot)
        assert app.screen.query_one(AlarmPane).cursor == before
        await pilot.press("k", "enter")
        assert station.acknowledged == [before.removeprefix("alarm:")]


async def test_an_unseen_pointer_never_decides_what_is_acknowledged(show: Show) -> None:
    async with show(living.alarmed(), size=SMALL) as (_, pilot, station, _):
        await pilot.press("escape", "j", "j", "f2", "k", "enter")
        assert station.acknowledged == [living.HOSTILE.id]


async def test_queue_keys_reach_the_mission_at_the_pointer(show: Show) -> None:
    async with show(living.alarmed()) as (_, pilot, station, _):
        await pilot.press(
            "escape", "o", "o", "u", "enter", "z", "enter", "o", "d", "enter", "x", "enter"
        )
        assert station.moved == [("M-005", -1), ("M-004", 1)]
        assert (station.deferred, station.withdrawn) == (["M-005"], ["M-004"])


@pytest.mark.parametrize("size", [SIZE, SMALL])
async def test_the_first_key_only_shows_what_it_would_be_about(
    show: Show, size: tuple[int, int]
) -> None:
    async with show(living.alarmed(), size=size) as (app, pilot, station, _):
        await press(pilot, "escape", "x", "enter")
        assert station.withdrawn == []
        assert sum("M-004" in text for text in notices(app)) == 1
        assert app.screen.query_one(AlarmPane).region.area
        await pilot.press("x", "enter")
        assert station.withdrawn == ["M-004"]


async def test_a_refusal_is_told(show: Show) -> None:
    station = ScriptedStation(living.alarmed())
    station.refuse = "M-004 does not wait"
    async with show(station) as (app, pilot, station, _):
        await press(pilot, "escape", "o", "z", "enter")
        assert sum("does not wait" in text for text in notices(app)) == 1


@pytest.mark.parametrize("where", [("escape",), ("escape", "slash")])
async def test_what_waits_behind_a_plan_says_so_and_goes_first_by_one_key(
    show: Show, where: tuple[str, ...]
) -> None:
    station = ScriptedStation(story.told("approval"))
    station.emit(ev.QueueChanged(entries=living.QUEUE[1:]), mission=None)
    async with show(station) as (app, pilot, station, _):
        line = app.screen.query_one(MissionPrompt).border_title
        waits = f"{living.QUEUE[1].mission.id} waits behind {story.MISSION.id}"
        assert f"{waits}: alt+b lets it go first" in str(line)
        await press(pilot, *where, "alt+b")
        assert station.let_first == 1


async def test_every_waiting_mission_has_place_priority_and_reason(show: Show) -> None:
    async with show(living.alarmed(), size=SMALL) as (app, pilot, _, _):
        await press(pilot, "escape", "5")
        text = shown(app, "#alarms")
        for words in ("1. M-004", "■ EMERGENCY", "WF-04: a confirmed threat", "2. M-005", "WF-05"):
            assert words in text


def test_queue_keys_are_legal_only_with_a_queue_and_never_in_a_replay() -> None:
    actions = [action for action in ACTIONS if action.keys in QUEUE_KEYS]
    assert len(actions) == len(QUEUE_KEYS)
    for action in actions:
        assert action.refusal(ActionContext())
        assert action.refusal(ActionContext(queue=1, replay=True))
        assert action.refusal(ActionContext(queue=1, readonly=True))
        assert not action.refusal(ActionContext(queue=1))


def test_no_key_of_the_console_approves_or_is_tmuxs() -> None:
    keys = {key for action in ACTIONS for key in action.keys.split(",")}
    assert not keys & {"a", "r", "m", "ctrl+b"}


async def test_stop_is_one_key_wherever_one_is(show: Show) -> None:
    async with show(living.alarmed()) as (_, pilot, station, _):
        for count, key in enumerate(
            ("i", "f10", "q", "f6", "f1", "f", "5", "M", "O", "V"), start=1
        ):
            await pilot.press("escape", key)
            await pilot.pause()
            await press(pilot, "f9")
            assert station.stopped == count
            await pilot.press("escape")
            await pilot.pause()


async def test_a_stop_shows_who_has_confirmed_until_a_mission_starts(show: Show) -> None:
    async with show(living.stopped(), size=SMALL) as (app, pilot, station, _):
        bar = app.screen.query_one(AlarmBar)
        text = str(bar.render())
        assert "ALL STOPPED" in text
        assert "7 hold, 1 not confirmed" in text
        assert bar.has_class("-stopped")
        station.emit(*story.planning()[:2])
        await settle(pilot)
        assert "ALL STOPPED" not in str(bar.render())


async def test_what_a_scenario_does_is_not_given_away(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, station, _):
        spoof = {"incident": {"kind": "spoof", "asset": "Ugv_T01", "frame": "Base"}}
        for source in ("scenario", "operator"):
            given = ev.IncidentHappened.model_validate({**spoof, "source": source})
            station.emit(given, mission=None)
            await settle(pilot)
            told_now = app.screen.query_one(EventList).text
            assert ("forged" in told_now) == (source == "operator")


async def test_the_alarm_under_the_pointer_can_be_followed_on_the_map(show: Show) -> None:
    async with show(living.alarmed()) as (app, pilot, _, _):
        await press(pilot, "escape", "t")
        assert "▸■‼4" in shown(app, "#map") or "following Track_04" in str(
            app.screen.query_one("#map").border_title
        )
        await pilot.press("t")
        assert "following" not in str(app.screen.query_one("#map").border_title)


async def test_typing_a_mission_types_and_does_not_acknowledge(show: Show) -> None:
    async with show(living.alarmed()) as (app, pilot, station, _):
        await pilot.press(*"kxz")
        assert app.screen.query_one(MissionInput).text == "kxz"
        assert station.acknowledged == []
        await pilot.press("f12")
        assert station.acknowledged == [living.HOSTILE.id]


async def test_the_event_list_goes_on_following_when_it_gets_smaller(show: Show) -> None:
    async with show(story.opening(), size=(120, 36)) as (app, pilot, station, _):
        for number in range(20):
            station.emit(ev.Noticed(level="info", subject="camera", text=f"frame {number}"))
        await settle(pilot)
        events = app.screen.query_one(EventList)
        for rows in (8, 3):
            events.styles.height = events.styles.max_height = rows
            await settle(pilot)
        assert events.max_scroll_y > 0
        assert events.scroll_offset.y == events.max_scroll_y
        events.scroll_to(y=2, animate=False, force=True, immediate=True)
        await settle(pilot)
        station.emit(ev.Noticed(level="info", subject="camera", text="one more"))
        await settle(pilot)
        assert events.scroll_offset.y == 2
