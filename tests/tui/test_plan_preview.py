"""A plan is seen before it runs: on the map, as a schedule, played, and beside other readings."""

from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Button

from pa_console.schema.events import event as ev
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import Motion
from pa_console.session.recording import Player
from pa_console.tui.app import ConsoleApp
from pa_console.tui.approval.panel import ARM_DELAY_S, ApprovalPanel
from pa_console.tui.approval.plan_view import PlanSchedule, schedule_lines
from pa_console.tui.approval.plan_words import action_rows, cover_row, objection
from pa_console.tui.map.plan_layer import PlanLayer
from pa_console.tui.map.scene import MapScene
from pa_console.tui.plan_preview import LONGEST_S, STAYS_S, PlanPreview
from pa_console.tui.rows import WrappedRow, layout
from pa_console.tui.screens.main import PLAY_FRAME_S
from pa_console.tui.widgets.map_view import MapView
from pa_console.tui.widgets.row_views import TextRows
from tests.tui import compound, living, story
from tests.tui.scripted import FakeClock, ScriptedStation, Show, press, settle, until
from tests.tui.site import WORLD
from tests.tui.story import stamped

pytestmark = pytest.mark.long

SIZE = (120, 36)
READING = "asked: 2 drones to EastGate"


def preview(plan: Plan = story.PLAN) -> PlanPreview:
    return PlanPreview(WORLD, plan, story.rehearsal())


def lost() -> PlanPreview:
    return PlanPreview(WORLD, compound.PLAN, compound.rehearsal())


def written(rows: list[WrappedRow], width: int = 100) -> list[str]:
    return [" ".join(line.plain.split()) for line in layout(rows, width)]


def plan_of(*actions: str) -> Plan:
    made = (action.split(maxsplit=1) for action in actions)
    return Plan(reason="", actions=tuple(Action(agent=a, command=c) for a, c in made))


# The rows


def test_a_row_tells_who_goes_from_where_to_where_how_long_and_at_what_charge() -> None:
    first, second = written(list(action_rows(preview())))
    assert first == "Drone_T04 UAV Checkpoint → North Gate, observes 6 s battery 21 → 20 %"
    assert second == "Robot_T01 robot Checkpoint → North Gate, identifies 31 s battery 87 → 84 %"


def test_nobody_is_sent_to_where_he_stands() -> None:
    plan = plan_of("Drone_T02 move_to NorthGate", "Drone_T03 hold", "Ugv_T01 report")
    stays, holds, reports = written(list(action_rows(preview(plan))))
    assert stays.startswith("Drone_T02 UAV stays at North Gate")
    assert holds.startswith("Drone_T03 UAV holds at South Gate")
    assert reports.startswith("Ugv_T01 UGV at East Gate, reports")
    assert not any("→ North" in line or "→ South" in line for line in (stays, holds, reports))


def test_equal_actions_share_a_row_that_names_everybody() -> None:
    given = compound.rehearsal()
    assert len(list(action_rows(lost()))) == len(compound.PLAN.actions)
    moved = given.before.assets["Drone_T02"].model_copy(update={"at": "Checkpoint"})
    assets = {**given.before.assets, "Drone_T02": moved}
    before = given.before.model_copy(update={"assets": assets})
    together = PlanPreview(WORLD, compound.PLAN, given.model_copy(update={"before": before}))
    first, *others = written(list(action_rows(together)), 200)
    assert len(others) == 2
    assert first.startswith("2 UAVs Checkpoint → East Gate 5 to 8 s battery 87 → 84 %")
    assert first.endswith("Drone_T04, Drone_T02")


def test_a_gate_that_loses_its_guards_is_told() -> None:
    row = cover_row(lost())
    assert row is not None
    assert "East Gate 1 → 3" in row.body.plain
    assert "North Gate 1 → 0, none left" in row.body.plain


def test_a_gate_that_is_without_guards_for_a_time_is_told_with_the_seconds() -> None:
    given = compound.rehearsal()
    gates = {**given.timeline.gates}
    gates["EastGate"] = gates["EastGate"].model_copy(update={"longest_gap_s": 4.0})
    timeline = given.timeline.model_copy(update={"gates": gates})
    plan = PlanPreview(WORLD, compound.PLAN, given.model_copy(update={"timeline": timeline}))
    row = cover_row(plan)
    assert row is not None
    assert "East Gate 1 → 3, none for 4 s" in row.body.plain
    assert "1→3 gap 4s" in roles(plan)[0]


def test_no_phrase_of_a_row_is_broken_where_it_fits_on_a_line() -> None:
    lines = written(list(action_rows(preview())), 46)
    assert "observes 6 s battery 21 → 20 %" in lines


def test_a_judge_that_objects_does_so_in_plain_words() -> None:
    said = "asked: 2 drones to EastGate; planned: 1 drone to EastGate; 1 of 2 drones"
    assert objection(said) == (
        "the order says send 2 drones to EastGate, the plan send 1 drone to EastGate: 1 of 2 drones"
    )
    assert objection("It goes too far.") == "It goes too far."


# The schedule


def test_the_schedule_tells_who_goes_when_and_how_many_guards_a_gate_has() -> None:
    axis, *lines = (line.plain for line in schedule_lines(lost(), 60))
    assert axis.split() == ["0", "s", "18", "s"]
    assert [line.split()[0] for line in lines[:3]] == ["Drone_T04", "Drone_T02", "Ugv_T02"]
    ends = [line.index("✔") for line in lines[:3]]
    assert ends == sorted(ends)
    counts = {line.split()[0]: [c for c in line if c.isdigit()] for line in lines[3:]}
    assert counts == {"North": ["1", "0"], "East": ["1", "2", "3"], "West": ["1", "2"]}


def test_who_waits_for_others_sets_out_later_on_the_schedule() -> None:
    given = compound.rehearsal()
    ways, actions = given.motion.trajectories, compound.PLAN.actions
    goes = [number for number, action in enumerate(actions) if action.agent in ways]
    waits, other = actions[goes[0]], actions[goes[1]]
    assert waits.agent != other.agent
    ordered = (
        *actions[: goes[0]],
        waits.model_copy(update={"after": (goes[1] + 1,)}),
        *actions[goes[0] + 1 :],
    )
    plan = compound.PLAN.model_copy(update={"actions": ordered})
    start, end = ways[waits.agent][0], ways[waits.agent][-1]
    way = (start, (3.0, *start[1:]), end)
    motion = given.motion.model_copy(update={"trajectories": {**ways, waits.agent: way}})
    shown = PlanPreview(WORLD, plan, given.model_copy(update={"motion": motion}))
    bars = {line.plain.split()[0]: line.plain for line in schedule_lines(shown, 60)}
    assert bars[waits.agent].index("━") > bars[other.agent].index("━")


def test_a_schedule_points_at_the_moment_that_is_played() -> None:
    at = [schedule_lines(lost(), 60, now)[0].plain.index("▼") for now in (0.0, 5.0, 18.0)]
    assert at == sorted(set(at))


def test_where_nobody_goes_there_is_no_schedule() -> None:
    still = story.rehearsal().model_copy(update={"motion": Motion()})
    still = still.model_copy(update={"after": still.before})
    plan = plan_of("Drone_T04 hold")
    assert schedule_lines(PlanPreview(WORLD, plan, still), 60) == []


# The map


def roles(plan: PlanPreview, time_s: float = 0.0) -> tuple[str, set[str]]:
    scene = MapScene(WORLD)
    canvas = scene.draw(plan.before, 100, 36, plan=PlanLayer(plan, scene.short, time_s))
    return "\n".join(canvas.lines()), {role for row in canvas.roles for role in row}


def test_the_map_shows_the_way_the_arrival_with_its_seconds_and_the_cover() -> None:
    text, seen = roles(preview())
    assert {"ghost", "arrival", "gate-gains", "dimmed"} <= seen
    assert "1→3 D4+6s R1+31s" in text
    assert "gate-loses" not in seen
    text, seen = roles(lost())
    assert "gate-loses" in seen
    assert "1→0" in text


@pytest.mark.parametrize("height", [11, 12])
def test_a_low_map_such_as_a_replay_s_names_what_the_plan_does_not_concern(height: int) -> None:
    scene, plan = MapScene(WORLD), preview()
    canvas = scene.draw(plan.before, 70, height, plan=PlanLayer(plan, scene.short))
    text = "\n".join(canvas.lines())
    aside = [name for name in plan.before.assets if name not in plan.involved]
    assert len(aside) > 4
    assert [name for name in aside if scene.short[name] not in text] == []


def test_what_is_in_trouble_is_never_dimmed() -> None:
    failed = living.seen_picture()
    told = story.rehearsal().model_copy(update={"before": failed})
    scene = MapScene(WORLD)
    plan = PlanPreview(WORLD, story.PLAN, told)
    plain = scene.draw(failed, 100, 36)
    seen = scene.draw(failed, 100, 36, plan=PlanLayer(plan, scene.short))
    for role in ("suspect", "stale", "track-hostile", "camera-failed"):
        assert sum(row.count(role) for row in seen.roles) >= 1
        assert sum(row.count(role) for row in plain.roles) >= 1


def test_the_rehearsed_picture_moves_agents_and_guards_and_nothing_else() -> None:
    plan = preview()
    half = plan.picture_at(15.5)
    assert half.assets["Drone_T04"].position == pytest.approx((3.0, 34.0))
    assert 4.0 < half.assets["Robot_T01"].position[1] < 36.0
    assert half.gates["NorthGate"].by == ("Drone_T02", "Drone_T04")
    assert half.assets["Ugv_T01"] == plan.before.assets["Ugv_T01"]
    assert plan.picture_at(0.0).assets["Drone_T04"].position == (2.0, 3.0)


# The console


def title(app: ConsoleApp) -> str:
    return str(app.screen.query_one(MapView).border_title)


async def armed(pilot: Pilot[Any], station: ScriptedStation, clock: FakeClock) -> None:
    await settle(pilot)
    clock.now += ARM_DELAY_S


@pytest.mark.parametrize("size", [(80, 24), SIZE, (200, 60)])
async def test_what_waits_is_on_the_map_and_gone_once_it_is_decided(
    size: tuple[int, int], show: Show
) -> None:
    async with show(story.told("approval"), size=size) as (app, pilot, station, clock):
        await armed(pilot, station, clock)
        view = app.screen.query_one(MapView)
        assert "1→3" in view.text()
        assert title(app) == "Map: the plan that waits"
        await press(pilot, "r", "enter")
        assert "1→3" not in view.text()
        assert title(app) == "Map"


async def test_space_plays_the_rehearsal_and_stops_it(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        await armed(pilot, station, clock)
        live = app.screen.query_one(MapView).text()
        await pilot.press("space")
        clock.now += LONGEST_S / 2
        await until(pilot, lambda: "REHEARSAL 19 s of 38 s" in title(app))
        assert "▼ 19 s" in app.screen.query_one("#schedule", PlanSchedule).lines(40)[0].plain
        panel = app.screen.query_one(ApprovalPanel)
        assert panel.border_subtitle == "Space stops the rehearsal"
        assert app.screen.query_one(MapView).text() != live
        await pilot.press("space")
        assert "REHEARSAL" not in title(app)
        assert app.screen.query_one(MapView).text() == live
        assert station.decisions == []


async def test_a_rehearsal_that_was_played_gives_way_to_the_live_picture(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        await armed(pilot, station, clock)
        await pilot.press("space")
        clock.now += LONGEST_S + STAYS_S + PLAY_FRAME_S
        await until(pilot, lambda: "REHEARSAL" not in title(app))
        await press(pilot, "a", "enter")
        assert station.decided == ["approve"]


async def test_a_space_in_the_middle_of_a_text_plays_nothing(show: Show) -> None:
    async with show(story.told("approval"), keys_by_clock=True) as (app, pilot, station, clock):
        await armed(pilot, station, clock)
        await press(pilot, *"he", "space", *"is")
        assert "REHEARSAL" not in title(app)
        assert station.decisions == []


async def test_what_is_played_ends_with_the_request(show: Show) -> None:
    async with show(story.told("approval")) as (app, pilot, station, clock):
        await armed(pilot, station, clock)
        await pilot.press("space")
        assert "REHEARSAL" in title(app)
        station.emit(ev.PlanVoided(attempt=1, reason="the situation changed"))
        await settle(pilot)
        assert title(app) == "Map"


async def test_another_reading_is_looked_at_before_it_is_chosen(show: Show) -> None:
    told = story.told("approval", confidence=0.41, readings=(READING,))
    station, clock = ScriptedStation(told), FakeClock()
    station.rehearsed[READING] = compound.reading()
    async with show(station, size=(120, 40), clock=clock) as (app, pilot, station, _):
        await armed(pilot, station, clock)
        own = app.screen.query_one(MapView).text()
        await pilot.press("alt+1")
        await until(pilot, lambda: "send 2 drones to EastGate" in title(app))
        assert "1→0" in app.screen.query_one(MapView).text()
        said = app.screen.query_one("#approval-looked-at", TextRows).render().plain
        assert "WF-03: NorthGate would be left" in " ".join(said.split())
        assert station.decisions == []
        await pilot.press("escape")
        await until(pilot, lambda: title(app) == "Map: the plan that waits")
        assert app.screen.query_one(MapView).text() == own
        assert app.screen.query_one("#reject", Button).has_focus
        await press(pilot, "alt+1", "enter")
        assert [(made.kind, made.asked) for made in station.decisions] == [("choose", READING)]


async def test_approve_is_about_the_plan_that_waits_whatever_was_looked_at(show: Show) -> None:
    told = story.told("approval", confidence=0.8, readings=(READING,))
    station, clock = ScriptedStation(told), FakeClock()
    station.rehearsed[READING] = compound.reading()
    async with show(station, size=(120, 40), clock=clock) as (app, pilot, station, _):
        await armed(pilot, station, clock)
        await pilot.press("alt+1")
        await until(pilot, lambda: "send 2 drones to EastGate" in title(app))
        await pilot.press("a")
        await until(pilot, lambda: title(app) == "Map: the plan that waits")
        await press(pilot, "enter")
        assert station.decided == ["approve"]


async def test_a_reading_that_cannot_be_rehearsed_says_so(show: Show) -> None:
    told = story.told("approval", confidence=0.41, readings=(READING,))
    async with show(told, size=(120, 40)) as (app, pilot, station, clock):
        await armed(pilot, station, clock)
        await pilot.press("alt+1")
        rows = app.screen.query_one("#approval-looked-at", TextRows)
        told = "The effects are known once this reading is planned."
        await until(pilot, lambda: told in " ".join(rows.render().plain.split()))
        assert title(app) == "Map"


async def test_a_plan_that_was_read_to_its_end_stays_read_when_it_is_played(show: Show) -> None:
    async with show(compound.told(), size=(80, 24)) as (app, pilot, station, clock):
        await armed(pilot, station, clock)
        approve = app.screen.query_one("#approve", Button)
        assert approve.disabled
        for _ in range(3):
            await press(pilot, "pagedown")
        assert not approve.disabled
        await press(pilot, "space")
        await press(pilot, "space")
        assert not approve.disabled


async def test_a_recorded_approval_shows_its_panel_and_decides_nothing(show: Show) -> None:
    player = Player.of(stamped(story.told("approval")))
    async with show(None, player=player) as (app, pilot, _, _):
        for _ in range(len(story.told("approval"))):
            await press(pilot, "right")
        panel = app.screen.query_one(ApprovalPanel)
        assert panel.display
        assert "Checkpoint → North Gate" in panel.query_one(TextRows).render().plain
        assert panel.border_subtitle == "nothing is decided here"
        assert not panel.query_one("#approval-buttons").is_on_screen
        assert "1→3" in app.screen.query_one(MapView).text()


async def test_panel_and_header_name_the_same_phase(show: Show) -> None:
    told = [*living.workflow(), *story.judged()[:-1]]
    station = ScriptedStation(told)
    station.emit(ev.ApprovalRequested(attempt=3, plan=story.PLAN, state="approve"))
    async with show(station) as (app, pilot, station, _):
        said = app.screen.query_one("#approval-text", TextRows).render().plain
        assert "phase warn of Track_01" in said
        station.emit(living.move(3))
        await settle(pilot)
        said = app.screen.query_one("#approval-text", TextRows).render().plain
        assert "phase escalate of Track_01; the plan was made for warn" in " ".join(said.split())


@pytest.mark.parametrize("size", [SIZE, (160, 50), (200, 60)])
async def test_the_scale_of_the_map_stays_when_the_prompt_grows(
    size: tuple[int, int], show: Show
) -> None:
    async with show(story.opening(), size=size) as (app, pilot, _, _):
        view = app.screen.query_one(MapView)
        before, rows = apart(view), view.size.height
        await press(pilot, *"one", "shift+enter", *"two", "shift+enter", *"three")
        assert view.size.height < rows
        assert apart(view) == before


def apart(view: MapView) -> tuple[int, int]:
    """How far two gates are apart on the map, in columns and rows."""
    lines = view.text().splitlines()

    def at(name: str) -> tuple[int, int]:
        return next((line.index(name), row) for row, line in enumerate(lines) if name in line)

    (west, top), (east, bottom) = at("NorthGate"), at("SouthGate")
    return east - west, bottom - top


def test_who_is_sent_to_several_places_comes_to_each_at_its_own_time() -> None:
    given = compound.rehearsal()
    frames, agent = WORLD.frames, "Drone_T04"
    at = [frames[place].at for place in ("WestGate", "NorthGate")]
    way = ((0.0, *frames["Checkpoint"].at), (6.0, *at[0]), (16.0, *at[0]), (24.0, *at[1]))
    motion = given.motion.model_copy(update={"trajectories": {agent: way}})
    plan = plan_of(f"{agent} observe WestGate", f"{agent} observe NorthGate")
    shown = PlanPreview(WORLD, plan, given.model_copy(update={"motion": motion}))
    assert shown.arrival_s(agent, "WestGate") == 6.0
    assert shown.arrival_s(agent, "NorthGate") == 24.0
    assert shown.arrival_s(agent, "SouthGate") is None
