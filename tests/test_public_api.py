"""What `import pa_console as pa` gives: its names, and the programs that the manual shows."""

import asyncio
import re
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

import pa_console as pa
from pa_console.api.station import STANDING_CONFIDENCE
from pa_console.llm.backend import EngineError
from pa_console.llm.models.catalogue import Catalog
from pa_console.schema.incident import FailAsset
from pa_console.settings.schema import Settings
from tests.scripted import SUCCESS, ScriptedEngine, plan, sure_engine

ROOT = Path(pa.__file__).parents[1]
PAGE = ROOT / "pa_console" / "manual" / "python-api.md"
EMBEDDING, APPROVER, ASK, CHECK, FLEET, LOG = re.findall(
    r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL
)

MISSION = "Move the drone to the east gate."
ASKED = "asked: 1 drone to EastGate"
SPARE = plan(("Drone_T04", "move_to EastGate"), reason=f"{ASKED}; Free drone: Drone_T04")
STRIPS = plan(("Drone_T02", "move_to EastGate"), reason="it leaves the North Gate alone")


def run_program(program: str) -> None:
    """Run a program as it stands."""
    exec(compile(program, "<program>", "exec"), {"__name__": "__main__"})


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Let stations ask a scripted model, and write their log to the file that is returned."""
    monkeypatch.chdir(tmp_path)
    log = tmp_path / "session.jsonl"
    engine = sure_engine(ASKED, SPARE, "EastGate").engine()
    answered = partial(pa.open_station, engine=engine, log=log)
    monkeypatch.setattr(pa, "open_station", answered)
    return log


def open_scripted(
    tmp_path: Path,
    approver: Callable[[pa.ApprovalRequested], object],
    planned: str | None = SPARE,
    **options: object,
) -> pa.Station:
    """Return a station whose planner answers `planned`, or never."""
    engine = ScriptedEngine([planned], [SUCCESS]).engine()
    log = tmp_path / "session.jsonl"
    return pa.open_station(pa.load_site(), approver=approver, engine=engine, log=log, **options)  # pyright: ignore[reportArgumentType]


def approve(request: pa.ApprovalRequested) -> pa.Decision:
    return pa.Decision(kind="approve", by="test", acknowledged=request.acknowledge)


def test_the_page_lists_every_name_and_no_other() -> None:
    table = "\n".join(re.findall(r"^\| `.*$", PAGE.read_text("utf-8"), re.MULTILINE))
    listed = re.findall(r"`(\w+)[^`]*`", table)
    assert set(listed) == set(pa.__all__)


def test_every_name_is_there_and_listed() -> None:
    for name in pa.__all__:
        assert getattr(pa, name) is not None
        assert name in dir(pa)
        assert getattr(pa, name).__doc__
    with pytest.raises(AttributeError, match="no attribute 'open_stations'"):
        _ = pa.open_stations  # pyright: ignore


@pytest.mark.parametrize(
    ("program", "without"),
    [
        ("import pa_console", {"textual", "llama_cpp", "pydantic", "numpy", "importlib.metadata"}),
        ("import pa_console; pa_console.Plan, pa_console.Decision", {"textual", "pa_console.llm"}),
        ("from pa_console import *", {"textual", "llama_cpp", "llguidance", "matplotlib"}),
    ],
)
def test_importing_brings_only_what_is_asked_for(program: str, without: set[str]) -> None:
    script = f"{program}\nimport sys; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, check=True, text=True
    )
    assert "pa_console" in done.stdout.split()
    assert not without & set(done.stdout.split())


def test_a_mission_runs_with_an_approver_of_ones_own(
    scripted: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_program(APPROVER)
    assert capsys.readouterr().out.startswith("verified telemetry shows every action")
    decided = [e.data for e in pa.read_log(scripted) if e.data.kind == "decision_made"]
    assert [made.decision.by for made in decided] == ["two_at_most"]


def test_a_question_is_answered_as_data_and_no_mission_is_made_of_it(
    scripted: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_program(ASK)
    assert "Robot_T02: now in place of Drone_T04: no rule is broken" in capsys.readouterr().out
    kinds = [event.data.kind for event in pa.read_log(scripted)]
    assert [kinds.count(each) for each in ("mission_received", "question_answered")] == [1, 1]


async def test_an_approver_may_ask_before_it_answers(tmp_path: Path) -> None:
    answers: list[pa.QuestionAnswered] = []

    async def asking(request: pa.ApprovalRequested) -> pa.Decision:
        answers.append(await station.ask("Why?"))
        return approve(request)

    station = open_scripted(tmp_path, asking)
    async with station:
        with pytest.raises(ValueError, match="cannot be answered here"):
            await station.ask("Send a drone to the west gate.")
        assert (await station.run_mission(MISSION)).status == "verified"
    (answer,) = answers
    said = {line.about: line.said for line in answer.lines}
    assert MISSION in said["order"]
    assert "waits for the operator" in said["decision"]
    with pytest.raises(RuntimeError, match="the session is over"):
        await station.ask("Why?")


def test_a_plan_is_checked_without_a_model(capsys: pytest.CaptureFixture[str]) -> None:
    run_program(CHECK)
    told = capsys.readouterr().out
    assert "WF-03 high every gate must stay covered: NorthGate left uncovered" in told
    assert "CAP-08 medium" in told


def test_a_station_drives_a_fleet_of_ones_own(
    scripted: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_program(FLEET)
    told = capsys.readouterr().out
    assert told.startswith("verified ")
    assert "'Drone_T04': 'EastGate'" in told
    assert told.endswith("the session is over\n")


def test_a_log_is_verified_and_read(scripted: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_program(EMBEDDING)
    assert capsys.readouterr().out.startswith("verified ")
    run_program(LOG)
    assert re.match(r"sound\n( +\d+ \w+\n)+$", capsys.readouterr().out)
    line = scripted.read_text("utf-8").replace("Drone_T04", "Drone_T05", 1)
    scripted.write_text(line, "utf-8")
    found = pa.verify_log(scripted)
    assert not found.intact
    assert found.damage == "edited-field"


@pytest.mark.long
def test_the_first_program_runs_with_the_default_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    catalog = Catalog.load()
    if catalog.get(catalog.default).local_file is None:
        pytest.skip("the default model is not on this machine")
    monkeypatch.chdir(tmp_path)
    run_program(EMBEDDING)
    assert capsys.readouterr().out.startswith("verified ")


async def test_an_approver_may_take_its_time(tmp_path: Path) -> None:
    told: list[str] = []

    async def ask_somebody(request: pa.ApprovalRequested) -> pa.Decision:
        while "text_streamed" not in told:
            await asyncio.sleep(0)
        return approve(request)

    def on_event(event: pa.Event, state: pa.SessionState) -> None:
        assert state.started is not None
        told.append(event.data.kind)

    async with open_scripted(tmp_path, ask_somebody, on_event=on_event) as station:
        outcome = await station.run_mission(MISSION)
    assert outcome.status == "verified", outcome.reason
    assert outcome.plan == pa.Plan.model_validate_json(SPARE)
    assert outcome.verification is not None
    assert outcome.verification.outcome == "pass"
    assert told[-1] == "session_ended"
    assert station.log is not None
    assert pa.verify_log(station.log).intact


async def test_an_approver_that_fails_is_a_rejection_and_is_told(tmp_path: Path) -> None:
    def fail(request: pa.ApprovalRequested) -> pa.Decision:
        raise LookupError(f"nobody is there for {request.attempt}")

    async with open_scripted(tmp_path, fail) as station:
        with pytest.raises(LookupError, match="nobody is there"):
            await station.run_mission(MISSION)
        await station.settled()
    [trace] = station.state.missions.values()
    assert trace.status == "rejected"
    assert "LookupError: nobody is there" in trace.reason


async def test_a_program_cannot_approve_what_nobody_may(tmp_path: Path) -> None:
    async with open_scripted(tmp_path, approve, STRIPS) as station:
        outcome = await station.run_mission(MISSION)
    assert outcome.status == "refused"
    assert "WF-03" in outcome.reason
    assert outcome.plan is None
    decisions = next(iter(station.state.missions.values())).decisions
    assert [made.accepted for made in decisions] == [False, True]


async def test_an_unsure_order_is_not_approved_by_auto_approver(tmp_path: Path) -> None:
    async with open_scripted(tmp_path, pa.auto_approver) as station:
        outcome = await station.run_mission(MISSION)
    assert outcome.status == "rejected"
    assert outcome.reason.startswith("too doubtful for a standing instruction")
    [trace] = station.state.missions.values()
    assert trace.decisions[-1].decision.by == "standing instruction: auto_approver"


def test_auto_approver_is_as_careful_as_the_command_line_is_by_default() -> None:
    assert Settings.model_fields["standing_confidence"].default == STANDING_CONFIDENCE


async def test_whoever_cancels_the_call_cancels_the_mission(tmp_path: Path) -> None:
    thinking = asyncio.Event()

    def on_event(event: pa.Event, _: pa.SessionState) -> None:
        if event.data.kind == "prompt_built":
            thinking.set()

    async with open_scripted(tmp_path, approve, None, on_event=on_event) as station:
        first = asyncio.create_task(station.run_mission(MISSION))
        await thinking.wait()
        second = asyncio.create_task(station.run_mission("Report, all of you."))
        await asyncio.sleep(0)
        second.cancel()
        first.cancel()
        await asyncio.wait([first, second])
        await station.settled()
    assert [trace.status for trace in station.state.missions.values()] == ["cancelled", "cancelled"]


async def test_a_mission_that_the_session_leaves_behind_is_told(tmp_path: Path) -> None:
    async with open_scripted(tmp_path, approve, None) as station:
        running = asyncio.create_task(station.run_mission(MISSION))
        await asyncio.sleep(0)
    with pytest.raises(RuntimeError, match="the session is over: closed by the program"):
        await running
    with pytest.raises(RuntimeError, match="the session is over"):
        await station.run_mission(MISSION)


async def test_a_failure_of_the_program_while_it_is_told_ends_the_session(tmp_path: Path) -> None:
    def on_event(event: pa.Event, _: pa.SessionState) -> None:
        if event.data.kind == "mission_received":
            raise KeyError("no such column")

    with pytest.raises(KeyError, match="no such column"):
        async with open_scripted(tmp_path, approve, on_event=on_event) as station:
            await station.run_mission(MISSION)
    assert pa.verify_log(tmp_path / "session.jsonl").intact


async def test_a_model_that_fails_holds_the_mission(tmp_path: Path) -> None:
    engine = ScriptedEngine([EngineError("out of memory")]).engine()
    log = tmp_path / "session.jsonl"
    async with pa.open_station(pa.load_site(), approver=approve, engine=engine, log=log) as station:
        outcome = await station.run_mission(MISSION)
    assert (outcome.status, outcome.plan) == ("held", None)


async def test_what_happens_in_a_simulation_is_seen_and_a_stop_is_obeyed(tmp_path: Path) -> None:
    async with open_scripted(tmp_path, approve) as station:
        station.inject({"kind": "spawn", "gate": "WestGate", "distance_m": 60.0})
        await station.advance(2.0)
        assert station.state.picture is not None
        assert [track.gate for track in station.state.picture.tracks.values()] == ["WestGate"]
        with pytest.raises(ValueError, match="distance_m"):
            station.inject({"kind": "spawn", "gate": "WestGate", "distance_m": "near"})
        station.stop_all()
        with pytest.raises(ValueError, match="stopped"):
            await station.run_mission(MISSION)
        station.release()
        assert (await station.run_mission(MISSION)).status == "verified"


async def test_a_plan_is_checked_against_what_a_fleet_reports_now() -> None:
    site = pa.load_site()
    move = pa.Plan.model_validate_json(plan(("Drone_T04", "move_to EastGate")))
    fleet = pa.SimulatedFleet.start(site.world, seed=1)
    assert not [f for f in pa.check_plan(move, site.rulebook, site.world, fleet=fleet) if f.broken]
    fleet.inject(FailAsset(asset="Drone_T04"))
    for _ in range(round(10.0 / site.world.dt_s)):
        fleet.step()
    broken = [f for f in pa.check_plan(move, site.rulebook, site.world, fleet=fleet) if f.broken]
    assert "Drone_T04" in " ".join(finding.message for finding in broken)


def test_a_plan_that_names_what_does_not_exist_is_told_as_it_is() -> None:
    world, rules = pa.load_world(), pa.load_rules()
    nowhere = pa.Plan.model_validate_json(plan(("Drone_T99", "move_to EastGate")))
    assert {finding.rule_id for finding in pa.check_plan(nowhere, rules, world)} == {"PLAN"}
    forced = "Shoot the driver."
    moves = pa.Plan.model_validate_json(SPARE)
    broken = [f.rule_id for f in pa.check_plan(moves, rules, world, mission=forced) if f.broken]
    assert broken == ["ROE-01"]
