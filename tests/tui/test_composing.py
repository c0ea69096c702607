"""Orders that are typed with help: names that complete, slots, earlier orders, favourites."""

import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from textual.pilot import Pilot

from pa_console.schema.document import DocumentError
from pa_console.schema.events.event import ManualControlTaken
from pa_console.session.recording import Player
from pa_console.settings.sources import load_settings
from pa_console.tui.app import ConsoleApp
from pa_console.tui.controllers.composing import Favourites
from pa_console.tui.order_templates import OrderNames, example_orders, next_slot, slots, templates
from pa_console.tui.screens.compose import Card, ChooseLine, LineRows
from pa_console.tui.screens.main import MainScreen
from pa_console.tui.widgets.assets import AssetTable
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.mission_prompt import (
    PUT_S,
    ExampleLine,
    ExampleOrders,
    MissionInput,
)
from tests.session.logs import write_log
from tests.tui import crowd, living, story
from tests.tui.scripted import Show, notices, press, settle, until
from tests.tui.site import WORLD
from tests.tui.story import stamped
from tests.tui.test_approval_state import as_a_terminal_sends
from tests.tui.test_replay import happened

SIZE = (120, 36)


def field(app: ConsoleApp) -> MissionInput:
    return app.screen.query_one(MissionInput)


# Names


@pytest.mark.parametrize(
    ("typed", "keys", "text"),
    [
        ("send dro", ("right",), "send Drone_T01"),
        ("send dro", ("tab",), "send Drone_T01"),
        ("send dro", ("tab", "tab", "tab"), "send Drone_T03"),
        ("send drone_t04 to ea", ("tab",), "send drone_t04 to EastGate"),
        ("look at north g", ("right",), "look at north gate"),
        ("watch Ba", ("tab",), "watch Base"),
        ("see to Track_0", ("tab",), "see to Track_01"),
    ],
)
async def test_a_name_that_is_begun_completes(
    typed: str, keys: tuple[str, ...], text: str, show: Show
) -> None:
    async with show(living.troubled()) as (app, pilot, station, _):
        await write(pilot, typed)
        await pilot.press(*keys)
        assert field(app).text == text
        assert station.submitted == []


async def test_enter_sends_what_was_typed_and_not_the_name_that_is_shown(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, station, _):
        await write(pilot, "send dro")
        assert field(app).suggestion == "ne_T01"
        await press(pilot, "enter")
        assert station.submitted == ["send dro"]


async def test_tab_leaves_the_field_where_nothing_completes(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await write(pilot, "hold")
        await pilot.press("tab")
        assert not field(app).has_focus
        assert field(app).text == "hold"


async def test_a_name_is_offered_only_at_the_end_of_a_word(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await write(pilot, "east")
        assert field(app).suggestion == "Gate"
        await pilot.press("left", "left")
        await pilot.pause()
        assert field(app).suggestion == ""
        await pilot.press("right")
        assert field(app).text == "east"


@given(st.sampled_from(sorted((*WORLD.assets, *WORLD.frames))), st.data())
def test_every_name_completes_from_any_beginning(name: str, data: st.DataObject) -> None:
    length = data.draw(st.integers(2, len(name) - 1))
    found = OrderNames(WORLD).completion(f"send {name[:length].lower()}")
    assert found is not None
    assert name in found.names


# Slots


@given(st.text(alphabet="ab {}\n", max_size=30), st.integers(0, 30))
def test_slots_are_where_the_text_has_them(text: str, after: int) -> None:
    for slot in slots(text):
        assert text[slot.start : slot.end] == f"{{{slot.kind}}}"
        assert len(slots(text[: slot.start] + "x" + text[slot.end :])) <= len(slots(text))
    found = next_slot(text, after)
    assert (found is None) == (not slots(text))


async def test_a_template_is_filled_slot_by_slot_and_sent_only_when_it_is_full(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, station, clock):
        await pilot.press("ctrl+t")
        await pilot.pause()
        await pilot.press(*"place", "enter")
        await pilot.pause()
        assert field(app).text == "Send {asset} to {place}."
        clock.now += PUT_S
        await pilot.press("enter")
        assert station.submitted == []
        assert any("{asset} is still open" in text for text in notices(app))
        await write(pilot, "dro")
        await pilot.press("tab", "tab")
        assert field(app).text == "Send Drone_T01 to {place}."
        assert field(app).selected_text == "{place}"
        await write(pilot, "EastGate")
        clock.now += PUT_S
        await press(pilot, "enter")
        assert station.submitted == ["Send Drone_T01 to EastGate."]


def test_templates_are_of_what_the_world_can_do() -> None:
    drones = {name: spec for name, spec in WORLD.assets.items() if spec.kind == "uav"}
    alone = WORLD.model_copy(update={"assets": drones})
    assert "Send {drone} to look at {gate}." in templates(WORLD)
    assert not any("block" in text or "warn" in text for text in templates(alone))
    assert "Send {asset} to look at {gate}." in templates(alone)


# Examples


@pytest.mark.parametrize("key", [["alt+2"], as_a_terminal_sends("\x1b2")])
@pytest.mark.parametrize("size", [(80, 24), SIZE])
async def test_an_example_is_typed_by_its_key_or_a_click_and_not_sent(
    size: tuple[int, int], key: list[str], show: Show
) -> None:
    async with show(story.opening(), size=size) as (app, pilot, station, clock):
        orders = example_orders(WORLD)
        await pilot.press(*key, "enter")  # the Enter may have been meant for something else
        assert field(app).text == orders[1]
        lines = list(app.screen.query(ExampleLine))
        assert await pilot.click(lines[0])
        await pilot.pause()
        assert field(app).text == orders[0]
        assert station.submitted == []
        clock.now += PUT_S
        await press(pilot, "enter")
        assert station.submitted == [orders[0]]


@pytest.mark.parametrize("seed", range(4))
async def test_no_keys_that_help_to_write_send_anything(seed: int, show: Show) -> None:
    """At most the Enter of a deliberate operator does, who has seen what was typed for him."""
    keys = ("ctrl+r", "ctrl+t", "ctrl+o", "ctrl+s", "alt+1", "alt+4", "tab", "right", "down", "1",
            "4", "enter", "enter", "escape", "f3")  # fmt: skip
    draw = random.Random(seed)
    async with show(story.opening()) as (_, pilot, station, _):
        for _ in range(40):
            await press(pilot, draw.choice(keys))
        digits = [text for text in station.submitted if not text.strip("14")]
        assert station.submitted == digits  # a digit typed into the field is the operator's text
        assert station.decisions == []


async def test_an_enter_that_is_held_sends_nothing_that_was_typed_for_the_operator(
    show: Show,
) -> None:
    async with show(story.opening()) as (_, pilot, station, clock):
        await pilot.press("alt+1")
        for _ in range(8):
            clock.now += PUT_S / 2
            await press(pilot, "enter")
        assert station.submitted == []


async def test_examples_are_gone_once_there_is_a_mission(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, _, _):
        assert not app.screen.query_one(ExampleOrders).display
        await pilot.press("escape", "slash", "alt+1")
        assert field(app).text == ""


def test_examples_name_what_the_loaded_world_has() -> None:
    large = crowd.world(20, 5)
    for world in (WORLD, large):
        text = " ".join(example_orders(world))
        assert len(example_orders(world)) == 4
        assert any(name in text for name in world.assets)
        assert any(gate in text for gate in world.gates)
    robots = {name: spec for name, spec in WORLD.assets.items() if spec.kind == "robot"}
    alone = example_orders(WORLD.model_copy(update={"assets": robots}))
    assert not any("Drone" in order or "Ugv" in order for order in alone)


# Earlier orders


async def test_earlier_orders_are_searched_and_typed(tmp_path: Path, show: Show) -> None:
    (tmp_path / "history.txt").write_text("Report on EastGate.\nSend Drone_T04 home.\n")
    async with show(story.opening()) as (app, pilot, station, _):
        await write(pilot, "draft")
        await pilot.press("ctrl+r")
        await pilot.pause()
        assert "Send Drone_T04 home." in app.screen.query_one(LineRows).text
        await pilot.press(*"east report", "enter", "enter")
        await pilot.pause()
        assert field(app).text == "Report on EastGate."
        assert station.submitted == []
        await pilot.press("ctrl+z")
        assert field(app).text == "draft"


async def test_orders_of_recorded_sessions_are_found_with_their_end(
    tmp_path: Path, show: Show
) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    write_log(logs / "one.jsonl", happened())
    async with show(story.opening(), settings=load_settings({"logs": str(logs)})) as (
        app,
        pilot,
        _,
        _,
    ):
        await pilot.press("ctrl+r")
        await until(pilot, lambda: app.screen.query_one(LineRows).keys)
        rows = app.screen.query_one(LineRows)
        assert any(status in rows.text for status in ("verified", "unverified", "open"))
        await pilot.press("enter")
        await pilot.pause()
        assert field(app).text == rows.keys[0]


@pytest.mark.parametrize("key", ["ctrl+r", "ctrl+t", "ctrl+o"])
async def test_over_another_screen_nothing_is_chosen_that_could_not_be_seen(
    key: str, show: Show
) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await pilot.press("f6")
        await pilot.pause()
        above = app.screen
        await pilot.press(key)
        await pilot.pause()
        assert app.screen is above
        assert any("Esc goes back to the session" in text for text in notices(app))


# Favourites


async def test_an_order_is_kept_chosen_and_removed(tmp_path: Path, show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        await write(pilot, "Watch {gate} for me.")
        await pilot.press("ctrl+s", "ctrl+a", "ctrl+k", "ctrl+t")
        await pilot.pause()
        assert app.screen.query_one(LineRows).cursor == "Watch {gate} for me."
        await pilot.press("enter")
        await pilot.pause()
        assert field(app).selected_text == "{gate}"
        await pilot.press("ctrl+t")
        await pilot.pause()
        await pilot.press("delete")
        assert "Watch {gate} for me." not in app.screen.query_one(LineRows).keys
    assert Favourites(tmp_path / "favourites.yaml").orders() == ()


@settings(max_examples=25)
@given(
    st.lists(
        st.text(st.characters(codec="utf-8", categories=("L", "P", "Zs")), min_size=1)
        .map(str.strip)
        .filter(bool),
        max_size=6,
        unique=True,
    )
)
def test_what_is_kept_is_read_again(
    tmp_path_factory: pytest.TempPathFactory, orders: list[str]
) -> None:
    kept = Favourites(tmp_path_factory.mktemp("kept") / "favourites.yaml")
    for order in orders:
        assert kept.keep(order)
    assert kept.orders() == tuple(orders)


@pytest.mark.parametrize(
    ("text", "line"), [("orders:\n- a\n- [b\n", 4), ("orders:\n- a\n- 3\n", 3), ("oders: []\n", 1)]
)
async def test_a_broken_file_is_named_with_its_line_and_not_touched(
    tmp_path: Path, text: str, line: int, show: Show
) -> None:
    file = tmp_path / "favourites.yaml"
    file.write_text(text)
    with pytest.raises(DocumentError) as told:
        Favourites(file).keep("Report.")
    assert told.value.line == line
    async with show(story.opening()) as (app, pilot, _, _):
        await write(pilot, "Report.")
        await pilot.press("ctrl+s", "ctrl+t")
        await pilot.pause()
        assert f"{file}:{line}" in " ".join(notices(app))
        assert isinstance(app.screen, ChooseLine)
    assert file.read_text() == text


def test_comments_in_the_file_stay(tmp_path: Path) -> None:
    kept = Favourites(tmp_path / "favourites.yaml")
    kept.file.write_text("# mine\norders:\n- Report.\n")
    kept.keep("Hold.")
    assert kept.file.read_text().startswith("# mine\n")
    assert kept.orders() == ("Report.", "Hold.")


# The map and the table


def cell_of(app: ConsoleApp, name: str) -> tuple[int, int]:
    """Where on the map, from its upper left corner, something is."""
    view = app.screen.query_one(MapView)
    width, height = view.content_size
    cells = ((x, y) for y in range(height) for x in range(width))
    return next(cell for cell in cells if name in view.names_at(cell))


async def click_map(pilot: Pilot[None], name: str, button: int = 1) -> None:
    app = pilot.app
    assert isinstance(app, ConsoleApp)
    column, row = cell_of(app, name)
    left, top = app.screen.query_one(MapView).gutter.left, app.screen.query_one(MapView).gutter.top
    assert await pilot.click(MapView, offset=(column + left, row + top), button=button)
    await pilot.pause()


async def write(pilot: Pilot[None], text: str) -> None:
    names = {" ": "space", ".": "full_stop", "_": "underscore", "{": "left_curly_bracket",
             "}": "right_curly_bracket"}  # fmt: skip
    await pilot.press(*(names.get(letter, letter) for letter in text))


async def test_the_card_of_an_asset_types_an_order_and_a_click_on_a_gate_fills_it(
    show: Show,
) -> None:
    async with show(story.opening()) as (app, pilot, station, clock):
        await click_map(pilot, "Drone_T02")
        await pilot.press(*("1" if isinstance(app.screen, Card) else ("down", "up")))
        if isinstance(app.screen, ChooseLine):
            await pilot.press(*"drone_t02", "enter")
            await pilot.pause()
            await pilot.press("1")
        await pilot.pause()
        assert field(app).text == "Send Drone_T02 to {place}."
        await click_map(pilot, "WestGate")
        if isinstance(app.screen, ChooseLine):
            await pilot.press(*"west", "enter")
            await pilot.pause()
        assert field(app).text == "Send Drone_T02 to WestGate."
        assert station.submitted == []
        clock.now += PUT_S
        await press(pilot, "enter")
        assert station.submitted == ["Send Drone_T02 to WestGate."]


async def test_every_gate_is_found_by_its_sign_and_by_its_name(show: Show) -> None:
    async with show(story.opening()) as (app, _, _, _):
        view = app.screen.query_one(MapView)
        rows = view.text().splitlines()
        for gate in WORLD.gates:
            row = next(number for number, line in enumerate(rows) if gate in line)
            first = rows[row].index(gate)
            for column in range(first, first + len(gate)):
                assert gate in view.names_at((column, row))
        assert view.names_at((0, len(rows) - 1)) == ()  # the legend is no place


async def test_the_card_offers_only_what_the_asset_can_do(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        offered: dict[str, str] = {}
        for name in ("Drone_T04", "Ugv_T01", "Robot_T01"):
            await pilot.press("ctrl+o")
            await pilot.pause()
            await pilot.press(*name.lower().replace("_", " ").split(" ")[0][:3])
            app.screen.query_one(LineRows).point_at(name)
            await pilot.press("enter")
            await pilot.pause()
            card = app.screen
            assert isinstance(card, Card)
            offered[name] = " ".join(choice.name for choice in card._choices)  # pyright: ignore[reportPrivateUsage]
            await pilot.press("escape")
            await pilot.pause()
        assert "Look at" in offered["Drone_T04"]
        assert "Block" not in offered["Drone_T04"]
        assert "Block" in offered["Ugv_T01"]
        assert "Look at" not in offered["Ugv_T01"]
        assert "Warn" in offered["Robot_T01"]


async def test_a_row_of_the_table_opens_the_card_and_enter_twice_sends_nothing(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, station, _):
        await pilot.press("f3")
        app.screen.query_one(AssetTable).point_at("Drone_T04")
        await pilot.press("enter")
        await pilot.pause()
        assert isinstance(app.screen, Card)
        await pilot.press("enter", "enter", "enter")
        await pilot.pause()
        assert station.submitted == []
        assert isinstance(app.screen, MainScreen)


async def test_manual_control_is_taken_and_given_back_by_a_key_of_the_card(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, station, _):
        await pilot.press("f3")
        app.screen.query_one(AssetTable).point_at("Drone_T04")
        await pilot.press("enter")
        await pilot.pause()
        await pilot.press("m")
        await pilot.pause()
        assert station.submitted == ["Take over Drone_T04."]
        station.emit(ManualControlTaken(asset="Drone_T04", by="operator"), mission=None)
        await settle(pilot)
        await pilot.press("enter")
        await pilot.pause()
        card = app.screen
        assert isinstance(card, Card)
        assert "MANUAL, taken by operator" in card._lines  # pyright: ignore[reportPrivateUsage]
        offered = [choice.name for choice in card._choices]  # pyright: ignore[reportPrivateUsage]
        assert offered == ["Follow on the map", "Give back (m)"]
        await pilot.press("m")
        await pilot.pause()
        assert station.submitted[1:] == ["Give Drone_T04 back."]


async def test_the_right_button_opens_a_menu_even_while_a_slot_is_open(show: Show) -> None:
    async with show(story.opening()) as (app, pilot, _, _):
        view = app.screen.query_one(MapView)
        empty = next(
            (x, y) for y in range(2, 12) for x in range(2, 60) if not view.names_at((x, y))
        )
        gutter = view.gutter
        assert await pilot.click(
            MapView, offset=(empty[0] + gutter.left, empty[1] + gutter.top), button=3
        )
        await pilot.pause()
        assert isinstance(app.screen, Card)
        await pilot.press("1")
        await pilot.pause()
        assert "×2" in str(app.screen.query_one(MapView).border_title)


async def test_a_cell_with_several_lets_choose(show: Show) -> None:
    site = crowd.world(1000, 50)
    async with show(crowd.opening(site), world=site) as (app, pilot, _, _):
        view = app.screen.query_one(MapView)
        cells = ((x, y) for y in range(30) for x in range(60))
        crowded = next(cell for cell in cells if len(view.names_at(cell)) > 3)
        names = view.names_at(crowded)
        gutter = view.gutter
        assert await pilot.click(
            MapView, offset=(crowded[0] + gutter.left, crowded[1] + gutter.top)
        )
        await pilot.pause()
        assert app.screen.query_one(LineRows).keys == list(names)
        await pilot.press("enter")
        await pilot.pause()
        assert isinstance(app.screen, Card)


async def test_in_a_recording_a_card_orders_nothing(show: Show) -> None:
    player = Player.of(stamped(story.told("finished")))
    async with show(None, player=player) as (app, pilot, _, _):
        await press(pilot, "n")
        app.controllers.composing.picked(("Drone_T04",), None, menu=False)
        await pilot.pause()
        card = app.screen
        assert isinstance(card, Card)
        assert [choice.name for choice in card._choices] == ["Follow on the map"]  # pyright: ignore[reportPrivateUsage]
