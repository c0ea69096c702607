"""What others on a TAK server report is on the map, and is never taken for what we see."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from pa_console.schema.events import event as ev
from pa_console.session.recording import Player
from pa_console.tui.app import ConsoleApp
from pa_console.tui.map.canvas import FREE
from pa_console.tui.map.scene import MapScene, short_name
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.row_views import EventList
from tests.tui import story
from tests.tui.scripted import Show, press, settle
from tests.tui.site import WORLD
from tests.tui.story import stamped

WIDE = (120, 36)
SCENE = MapScene(WORLD)


def shown_map(app: ConsoleApp) -> str:
    return app.screen.query_one(MapView).text()


async def test_a_contact_is_on_the_map_until_it_is_lost(show: Show) -> None:
    async with show(story.opening(), size=WIDE) as (app, pilot, station, _):
        before = shown_map(app)
        assert "◌" not in before
        station.emit(story.TAK_UP, *story.reported(), mission=None)
        await settle(pilot)
        with_contacts = shown_map(app)
        assert "TAK ALPHA 1 friend?" in with_contacts
        assert "TAK RED 7 hostile?" in with_contacts
        assert "◌ TAK, unverified" in with_contacts
        lines = app.screen.query_one(EventList).text
        assert "reported, not seen by our sensors: “RED 7”" in " ".join(lines.split())
        for uid in ("ANDROID-1", "ANDROID-2"):
            station.emit(ev.ContactLost(uid=uid, reason="stale"), mission=None)
        await settle(pilot)
        assert shown_map(app) == before


async def test_a_replay_shows_it_where_it_was_reported(show: Show) -> None:
    lost = [ev.ContactLost(uid=f"ANDROID-{n}", reason="stale") for n in (1, 2)]
    player = Player.of(stamped([*story.opening(), story.TAK_UP, *story.reported(), *lost]))
    async with show(None, size=WIDE, player=player) as (app, pilot, _, _):
        seen: list[tuple[bool, bool]] = []
        for _ in range(len(player.recording)):
            await press(pilot, "right")
            shown = shown_map(app)
            seen.append(("TAK ALPHA 1" in shown, "TAK RED 7" in shown))
        begin = len(seen) - len(lost) - len(story.reported())
        assert seen[begin:] == [(True, False), (True, True), (False, True), (False, False)]
        assert not any(any(each) for each in seen[:begin])


async def test_a_contact_cannot_be_pointed_at(show: Show) -> None:
    async with show([*story.opening(), story.TAK_UP, *story.reported()], size=WIDE) as (
        app,
        _,
        _,
        _,
    ):
        view = app.screen.query_one(MapView)
        cells = [
            (column, row)
            for row, line in enumerate(shown_map(app).split("\n")[:-1])
            for column, glyph in enumerate(line)
            if glyph == "◌"
        ]
        assert len(cells) == 2
        known = {*WORLD.frames, *WORLD.assets, *story.PICTURE.tracks}
        assert all(set(view.names_at(cell)) <= known for cell in cells)
        assert not view.follow("ANDROID-1")


contacts = st.builds(
    ev.ReportedContact,
    uid=st.text(min_size=1, max_size=20),
    callsign=st.text(max_size=48),
    affiliation=st.sampled_from(("friend", "hostile", "other")),
    what=st.just("vehicle"),
    at=st.tuples(st.floats(-400.0, 400.0), st.floats(-400.0, 400.0)),
    time=st.just(story.START),
    stale=st.just(story.START),
)


@given(
    st.lists(contacts, max_size=ev.MOST_CONTACTS),
    st.integers(2, 120),
    st.integers(2, 40),
    st.sampled_from(((1.0, None), (4.0, (0.0, 30.0)))),
)
def test_what_is_ours_on_the_map_is_the_same_whatever_others_report(
    reported: list[ev.ReportedContact],
    width: int,
    height: int,
    window: tuple[float, tuple[float, float] | None],
) -> None:
    alone = SCENE.draw(story.PICTURE, width, height, window)
    beside = SCENE.draw(story.PICTURE, width, height, window, contacts=reported)
    assert (beside.marks, beside.labels) == (alone.marks, alone.labels)
    cells = [(column, row) for column in range(width) for row in range(height)]
    changed = [
        cell
        for cell in cells
        if (beside.roles[cell[1]][cell[0]], beside.glyphs[cell[1]][cell[0]])
        != (alone.roles[cell[1]][cell[0]], alone.glyphs[cell[1]][cell[0]])
    ]
    assert {beside.role(cell) for cell in changed} <= {"contact", "leader"}
    assert {alone.role(cell) for cell in changed} <= FREE | {"wall"}
    assert all(len(line) == width == cell_len(line) for line in beside.lines())


@pytest.mark.parametrize(
    ("name", "shown"),
    [("ALPHA 1", "ALPHA 1"), ("漢字A", "??A"), ("é\u0301", "é?"), ("x" * 40, "x" * 13 + "…")],
)
def test_a_call_sign_fits_into_cells(name: str, shown: str) -> None:
    assert short_name(name) == shown
