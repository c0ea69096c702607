"""How times are read: canonical words come back as they went in, and what is no time is none."""

from datetime import UTC, datetime, time, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pa_console.language.clock_words import duration_words, unread_times
from pa_console.language.orders.order_changes import OrderChange, read_change
from pa_console.language.orders.timed_orders import ReadTimed, read_timed
from pa_console.language.references.conversation import Unclear
from pa_console.mission.spelling import read_words
from pa_console.policy.rulebook import load_rules
from pa_console.resources import existing_data
from pa_console.schema.mission import Schedule, StandingOrder
from pa_console.sim.worlds.world_file import open_world

WORLD = open_world("checkpoint")[0]
NOW = datetime(2026, 11, 25, 8, 20, tzinfo=UTC)
ORDERS = st.sampled_from((
    "Send a drone to the east gate", "Drone_T04 observe WestGate", "Ugv_T02 blocks the north gate",
    "Two robots go to Depot", "Have Robot_T01 hold position",
))  # fmt: skip
SECONDS = st.integers(60, 20_000).map(float)
TODAY = st.integers(1, 15 * 3600).map(lambda seconds: NOW + timedelta(seconds=seconds))


def read(text: str) -> ReadTimed:
    found = read_timed(WORLD, text, NOW)
    assert isinstance(found, ReadTimed), f"{text}: {found}"
    return found


def joined(order: str, time: str, *, first: bool) -> str:
    return f"{time.capitalize()}, {order}." if first else f"{order} {time}."


@given(ORDERS, TODAY, st.booleans())
def test_a_clock_time_is_read_as_it_was_written(order: str, at: datetime, first: bool) -> None:
    found = read(joined(order, f"at {at:%H:%M:%S}", first=first))
    assert found.schedule == Schedule(start=at)
    assert found.order.rstrip(".").lower() == order.lower()


@given(ORDERS, SECONDS, st.booleans())
def test_a_duration_is_read_as_it_was_written(order: str, seconds: float, first: bool) -> None:
    found = read(joined(order, f"in {duration_words(seconds)}", first=first))
    assert found.schedule == Schedule(start=NOW + timedelta(seconds=seconds))
    assert found.order.rstrip(".").lower() == order.lower()


@given(ORDERS, SECONDS, TODAY, st.integers(2, 20), st.booleans())
def test_an_interval_with_its_end_is_read_as_it_was_written(
    order: str, every_s: float, until: datetime, times: int, first: bool
) -> None:
    every = f"every {duration_words(every_s)}"
    found = read(joined(order, f"{every} until {until:%H:%M:%S}", first=first)).schedule
    assert (found.start, found.every_s, found.until) == (NOW, every_s, until)
    found = read(joined(order, f"{every}, {times} times", first=first)).schedule
    assert (found.at_once, found.every_s, found.times) == (True, every_s, times)


@given(ORDERS, SECONDS, st.sampled_from(("and then back", ", then RTB", "")))
def test_a_stay_is_read_as_it_was_written(order: str, seconds: float, then: str) -> None:
    schedule = read(f"{order} for {duration_words(seconds)} {then}".strip()).schedule
    assert (schedule.stay_s, schedule.every_s) == (seconds, 0.0)
    assert schedule.to_base == ("RTB" in then)


@given(st.text(st.characters(codec="utf-8"), max_size=60))
def test_no_text_breaks_the_reading(text: str) -> None:
    assert isinstance(read_timed(WORLD, text, NOW), ReadTimed | Unclear | None)


@pytest.mark.parametrize(
    "text",
    [
        "Send two robots to the north gate.", "At two gates we need drones.",
        "Send every drone home.",
        "The storm will hit in an hour, so Drone_T04 has to return to base.",
        "There is a fire drill at the base at noon. Bring Robot_T02 to the checkpoint.",
        "Drone T02 has been up since noon, let Drone T04 relieve her at North.",
        "Nobody gets hurt today, bring Ugv_T01 back to base.",
        "Move Ugv_T02 to the gate within five minutes.", "D4 home, from now on.",
        "Take a few shots of the west gate for the daily brief.",
    ],
)  # fmt: skip
def test_what_is_no_time_of_the_order_is_none(text: str) -> None:
    assert read_timed(WORLD, text, NOW) is None


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("Send a drone to the north gate at nine.", "in the morning or in the evening"),
        ("At 07:30 Drone_T04 home.", "has passed"),
        ("Every second send a drone to the east gate.", "too often"),
        ("At 16:45 Drone_T04 home and at 17:00 Drone_T03 home.", "two times"),
        ("Tomorrow Drone_T04 home.", "At what time"),
        ("In a few minutes send Drone_T04 home.", "gives no exact starting time"),
        ("Every ten minutes look at the depot with Drone_T04 until 08:10.", "has passed"),
        ("At 16:45.", "What is to be done"),
    ],
)
def test_a_time_that_cannot_be_kept_gets_a_clear_line(text: str, why: str) -> None:
    found = read_timed(WORLD, text, NOW)
    assert isinstance(found, Unclear)
    assert why in found.question


def test_an_answer_settles_the_time() -> None:
    text = "Send a drone to the north gate at nine."
    asked = read_timed(WORLD, text, NOW)
    assert isinstance(asked, Unclear)
    assert asked.choices == ("at 09:00", "at 21:00")
    found = read_timed(WORLD, text, NOW, {asked.words: asked.choices[1]})
    assert isinstance(found, ReadTimed)
    assert found.schedule.start.hour == 21


def order(name: str, text: str) -> StandingOrder:
    schedule = Schedule(start=NOW, every_s=600.0)
    return StandingOrder(
        id=name, text=text, schedule=schedule, words="every 10 minutes", order=text
    )


WEST = order("S1", "every ten minutes patrol west and north with Drone_T04")
EAST = order("S2", "every hour have Drone_T03 look at the east gate")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("stop the west patrol", OrderChange("revoke", ("S1",))),
        ("pause S2", OrderChange("pause", ("S2",))),
        ("Resume the hourly look at the east gate, please.", OrderChange("resume", ("S2",))),
        ("cancel all standing orders", OrderChange("revoke", ("S1", "S2"))),
        ("stop the drone at the west gate", None),
        ("stop", None),
        ("Stop Drone_T04.", None),
        ("hold position", None),
    ],
)
def test_orders_in_force_are_changed_by_words_and_assets_are_not(
    text: str, expected: OrderChange | None
) -> None:
    assert read_change(text, (WEST, EAST)) == expected
    assert read_change(text, ()) is None


def test_which_order_is_meant_is_asked_where_several_fit() -> None:
    found = read_change("skip the next one, then carry on as normal", (WEST, EAST))
    assert isinstance(found, Unclear)
    assert "S1" in found.question
    one = read_change("skip the next one, then carry on as normal", (WEST,))
    assert one == OrderChange("skip", ("S1",))


DATA = Path(__file__).with_name("data") / "timed_orders.yaml"
WRITTEN: list[dict[str, Any]] = yaml.safe_load(DATA.read_text(encoding="utf-8"))
RULES = load_rules(existing_data("rules", "checkpoint", "rules.yaml"))
WEDNESDAY = datetime(2026, 11, 25, 14, 20, tzinfo=UTC)


def moment(said: str | None) -> datetime | None:
    """Return a moment as the data write it: *now*, *16:45:00*, *tomorrow 02:00:00*."""
    if said is None or said == "now":
        return WEDNESDAY if said else None
    at = time.fromisoformat(said.removeprefix("tomorrow "))
    day = WEDNESDAY.date() + timedelta(days=said.startswith("tomorrow"))
    return datetime.combine(day, at, UTC)


@pytest.mark.parametrize(
    "case",
    [case for case in WRITTEN if case["kind"] in ("once", "recurring", "stay")],
    ids=lambda case: case["text"],
)
def test_orders_that_somebody_else_wrote_are_read_as_they_were_meant(
    case: dict[str, Any],
) -> None:
    text = read_words(case["text"], WORLD, RULES)
    found = read_timed(WORLD, text, WEDNESDAY)
    assert isinstance(found, ReadTimed)
    schedule = found.schedule
    assert schedule.start == moment(case["start"])
    assert schedule.every_s == (case["every_s"] or 0)
    assert (schedule.until or schedule.leave) == moment(case["until"])
    assert (schedule.times or None, schedule.stays) == (case["times"], case["kind"] == "stay")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("iIn one minute send a drone to the east gate", "one minute"),
        ("Send a drone to the east gate within ten minutes.", "ten minutes"),
        ("Send Drone_T04 to the west gate 5 sharp", "5"),
    ],
)
def test_a_time_that_no_phrase_takes_up_is_found(text: str, named: str) -> None:
    assert read_timed(WORLD, text, NOW) is None
    assert unread_times(WORLD, text) == (named,)


@pytest.mark.parametrize(
    "text",
    [
        "Send two drones to the second gate.",
        "I need a second guard at the west gate, when you have a minute.",
        "A car came two minutes ago, send a robot to the east gate.",
        "Drone_T02 has been up since noon, relieve it.",
        "Robot_T01 has ten minutes of battery left, relieve it.",
    ],
)
def test_what_tells_of_another_time_is_none_of_the_order(text: str) -> None:
    assert unread_times(WORLD, text) == ()


@pytest.mark.parametrize(
    ("text", "start", "every_s"),
    [
        ("Drone_T03 RTB 2130", "2130", 0.0),
        ("Bring Ugv_T02 home midnite", "0000", 0.0),
        ("2200 sharp: Ugv_T02 to the south gate", "2200", 0.0),
        ("Robot_T02 to the east gate 16 30", "1630", 0.0),
        ("top of the hour, Drone_T04 to the east gate", "0900", 0.0),
        ("at the bottom of the hour Drone_T04 home", "0830", 0.0),
        ("five past each hour: Drone_T04 looks at the north gate", "0905", 3600.0),
        ("Drone_T04 looks at the north gate at quarter to every hour", "0845", 3600.0),
        ("every top of the hour look at the depot with Drone_T04", "0900", 3600.0),
        ("in 10 mikes send Robot_T02 to the checkpoint", "0830", 0.0),
        ("t+15 Drone_T04 home", "0835", 0.0),
        ("send Drone_T04 north in 5", "0825", 0.0),
        ("fourteen hundred hours Drone_T04 home", "1400", 0.0),
        ("oh nine thirty: Drone_T04 home", "0930", 0.0),
        ("Drone_T04 home around 1700", "1700", 0.0),
        ("Drone_T04 home @ 3:15p", "1515", 0.0),
        ("once an hour on the half hour Drone_T04 looks at the depot", "0830", 3600.0),
    ],
)
def test_times_as_they_are_given_on_a_radio(text: str, start: str, every_s: float) -> None:
    found = read(text).schedule
    assert (f"{found.start:%H%M}", found.every_s) == (start, every_s)


@pytest.mark.parametrize(
    ("text", "stay_s", "leave"),
    [
        ("At 1630 Drone_T03 looks at the east gate, back at 1700", 0.0, "1700"),
        ("Drone_T04 to the depot, five minutes, then return", 300.0, ""),
    ],
)
def test_a_stay_is_read_by_its_end(text: str, stay_s: float, leave: str) -> None:
    found = read(text).schedule
    assert found.stay_s == stay_s
    assert (f"{found.leave:%H%M}" if found.leave else "") == leave


@pytest.mark.parametrize(
    "text",
    [
        "Send drone 2130 to the gate.", "Send two hundred metres of cable to Drone_T04.",
        "Bring 2 drones home.", "Send a drone to gate 1a.", "Robot_T01, report on 3 gates.",
    ],
)  # fmt: skip
def test_a_number_of_something_is_no_time(text: str) -> None:
    assert not isinstance(read_timed(WORLD, text, NOW), ReadTimed)


JUNK = st.lists(
    st.sampled_from((
        "5", "17", "2130", "five", "quarter", "past", "to", "each", "every", "top", "of", "the",
        "in", "at", "sharp", "around", "till", "nlt", "t", "+", "for", "and", "back",
    )),
    max_size=3,
)  # fmt: skip
CLOCK_WORDS = st.sampled_from(("hour", "minutes", "2130", "midnite", "tomorrow", "mikes", "noon"))


@given(ORDERS, JUNK, CLOCK_WORDS, JUNK, st.booleans())
def test_no_word_of_the_clock_is_lost_in_silence(
    order: str, before: list[str], word: str, after: list[str], first: bool
) -> None:
    said = " ".join((*before, word, *after))
    text = f"{said}: {order}" if first else f"{order} {said}"
    found = read_timed(WORLD, text, NOW)
    if isinstance(found, ReadTimed):
        assert word not in found.order.lower().split() or unread_times(WORLD, found.order)
    elif found is None:
        assert unread_times(WORLD, text)


@pytest.mark.parametrize(
    "way",
    [
        "by 16:45",
        "NLT 1800",
        "no later than 18:00",
        "after lunch",
        "before half past four in the afternoon",
    ],
)
def test_what_is_no_moment_to_begin_is_asked_back(way: str) -> None:
    found = read_timed(WORLD, f"Send Drone_T04 to the north gate {way}.", NOW)
    assert isinstance(found, Unclear)
    assert way in found.question
