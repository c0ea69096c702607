"""`pa-console replay --resimulate`: a log whose telemetry does not come out again is told."""

import asyncio
import hashlib
import json
from pathlib import Path

import pytest

from pa_console.resources import find_data
from pa_console.schema.document import Document
from pa_console.schema.incident import Scenario
from pa_console.station.assembly import Site, load_site
from tests.cli.inside import Call, Done
from tests.evaluation.sessions import IDENTIFY, RECON, WARN, play
from tests.scripted import ScriptedEngine

SCENARIO = """\
name: one-van
title: A van at the West Gate
about: for a test
duration_s: 40
events:
  - {at_s: 0, do: {kind: radio, jitter_s: 0.2, loss: 0.2}}
  - {at_s: 1, do: {kind: spawn, gate: WestGate, distance_m: 60}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a scenario, a recorded session of it, and a generated world."""
    path = tmp_path_factory.mktemp("session")
    (path / "one-van.yaml").write_text(SCENARIO, encoding="utf-8")
    record(load_site("checkpoint", "checkpoint"), path / "session.jsonl")
    return path


def record(site: Site, log: Path) -> None:
    """Play the scenario with scripted plans and write its log."""
    played = Document("scenario", SCENARIO).parse(Scenario)
    asyncio.run(play(site, ScriptedEngine([RECON, IDENTIFY, WARN]), played, seed=2, log=log))


def resimulate(call: Call, folder: Path, log: Path, *words: str) -> Done:
    return call(
        "replay", str(log), "--resimulate", "--scenario", str(folder / "one-van.yaml"), *words
    )


def tampered(folder: Path, target: Path, kind: str, old: str, new: str) -> Path:
    """Write the log with `old` replaced in the first record of `kind`."""
    lines = (folder / "session.jsonl").read_text(encoding="utf-8").splitlines(keepends=True)
    number = next(n for n, line in enumerate(lines) if json.loads(line)["kind"] == kind)
    assert old in lines[number]
    lines[number] = lines[number].replace(old, new)
    target.write_text("".join(lines), encoding="utf-8")
    return target


def test_an_honest_log_comes_out_equal(call: Call, folder: Path) -> None:
    log = folder / "session.jsonl"
    done = resimulate(call, folder, log)
    assert done.code == 0, done.err
    pictures = sum('"kind":"telemetry"' in line for line in log.read_text().splitlines())
    assert f"{pictures} pictures and 3 rehearsals of plans are equal" in done.said
    document = resimulate(call, folder, log, "--json").json
    assert (document["pictures"], document["different"]) == (pictures, 0)
    assert (document["rehearsals"], document["different_rehearsals"]) == (3, 0)
    assert document["first_line"] is None
    assert document["recorded_sha256"] == document["repeated_sha256"]


def test_a_tampered_command_differs(call: Call, folder: Path, tmp_path: Path) -> None:
    log = tampered(folder, tmp_path / "forged.jsonl", "command_sent", "WestGate", "EastGate")
    done = resimulate(call, folder, log)
    assert done.code == 1
    assert "of plans are equal" not in done.out
    assert "differ, first at tick" in done.said
    shown = resimulate(call, folder, log, "--json")
    assert shown.code == 1
    assert shown.json["different"] > 0
    assert call("replay", str(log), "--verify").code == 2


def test_a_doctored_rehearsal_differs_on_its_line(call: Call, folder: Path, tmp_path: Path) -> None:
    was, now = '"covered_before":true', '"covered_before":false'
    log = tampered(folder, tmp_path / "forged.jsonl", "plan_rehearsed", was, now)
    done = resimulate(call, folder, log)
    assert done.code == 1
    lines = log.read_text(encoding="utf-8").splitlines()
    number = next(n for n, line in enumerate(lines, 1) if '"kind":"plan_rehearsed"' in line)
    assert f"{log}:{number}: 0 of" in done.said
    assert "1 of 3 rehearsals differ, first at tick" in done.said
    assert "rehearsal of plan 1: timeline: gates of " in done.said
    assert resimulate(call, folder, log, "--json").json["first_line"] == number


def test_a_log_that_breaks_off_in_a_bad_line_is_not_called_equal(
    call: Call, folder: Path, tmp_path: Path
) -> None:
    log = tampered(folder, tmp_path / "bad.jsonl", "command_sent", '"data"', '"date"')
    number = next(n for n, line in enumerate(log.read_text().splitlines(), 1) if '"date"' in line)
    done = resimulate(call, folder, log)
    assert done.code != 0
    assert f"{log}:{number}" in done.err


def test_another_situation_than_the_sessions_differs(
    call: Call, folder: Path, tmp_path: Path
) -> None:
    other = tmp_path / "one-van.yaml"
    other.write_text(SCENARIO.replace("at_s: 1,", "at_s: 9,"), encoding="utf-8")
    log = str(folder / "session.jsonl")
    done = call("replay", log, "--resimulate", "--scenario", str(other))
    assert done.code == 1
    assert "differ" in done.said


def test_the_files_of_the_session_are_asked_for_by_option(
    call: Call, folder: Path, tmp_path: Path
) -> None:
    done = call("replay", str(folder / "session.jsonl"), "--resimulate")
    assert done.code == 2
    assert "one-van" in done.err
    assert "--scenario" in done.err
    world = tmp_path / "yard.yaml"
    call("world", "generate", "--gates", "2", "--assets", "3", "-o", str(world))
    log = tmp_path / "yard.jsonl"
    played = Scenario(name="quiet", title="", about="", duration_s=5)
    engine = ScriptedEngine([RECON])
    asyncio.run(play(load_site(str(world), "checkpoint"), engine, played, log=log))
    quiet = tmp_path / "quiet.yaml"
    quiet.write_text(played.model_dump_json(), encoding="utf-8")
    words = ("replay", str(log), "--resimulate", "--scenario", str(quiet))
    missing = call(*words)
    assert missing.code == 2
    assert "--world" in missing.err
    assert call(*words, "--world", str(world)).code == 0
    assert call(*words, "--world", "checkpoint").code == 1


def test_another_world_of_the_same_name_is_not_taken_for_the_sessions(
    call: Call, tmp_path: Path
) -> None:
    shipped = find_data("worlds", "checkpoint", "world.yaml").read_text(encoding="utf-8")
    world, log, quiet = (tmp_path / name for name in ("own.yaml", "own.jsonl", "quiet.yaml"))
    world.write_text(shipped.replace("standoff_m: 10.0", "standoff_m: 12.0"), encoding="utf-8")
    played = Scenario(name="quiet", title="", about="", duration_s=5)
    quiet.write_text(played.model_dump_json(), encoding="utf-8")
    site = load_site(str(world), "checkpoint")
    assert site.world.name == "checkpoint"
    asyncio.run(play(site, ScriptedEngine([RECON]), played, log=log))
    words = ("replay", str(log), "--resimulate", "--scenario", str(quiet))
    missing = call(*words)
    assert missing.code == 2
    assert "as it was in this session" in missing.err
    assert call(*words, "--world", str(world)).code == 0
    assert "note: checkpoint differs from the world" in call(*words, "--world", "checkpoint").err


def test_another_scenario_of_the_same_name_is_not_taken_for_the_sessions(
    call: Call, folder: Path, tmp_path: Path
) -> None:
    world, own = tmp_path / "world.yaml", tmp_path / "scenarios" / "one-van.yaml"
    world.write_bytes(find_data("worlds", "checkpoint", "world.yaml").read_bytes())
    own.parent.mkdir()
    own.write_text(SCENARIO, encoding="utf-8")
    pinned = hashlib.sha256(own.read_bytes()).hexdigest()
    log = tampered(folder, tmp_path / "own.jsonl", "session_started", "0" * 64, pinned)
    words = ("replay", str(log), "--resimulate", "--world", str(world))
    again = call(*words)
    assert (again.code, again.err) == (0, "")
    own.write_text(SCENARIO.replace("at_s: 1,", "at_s: 9,"), encoding="utf-8")
    other = call(*words)
    assert other.code == 2
    assert (
        "'one-van' of this session is not installed here, or it has changed "
        f"(SHA-256 {pinned[:12]})" in other.err
    )
    assert "--scenario" in other.err
    given = call(*words, "--scenario", str(own))
    assert given.code == 1
    assert f"note: {own} differs from the scenario of this session" in given.err
    assert call(*words, "--scenario", str(folder / "one-van.yaml")).code == 0


def test_something_that_is_no_log_is_refused(call: Call, tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("not a log\n", encoding="utf-8")
    done = call("replay", str(path), "--resimulate")
    assert done.code == 2
    assert f"{path}:1" in done.err
    assert call("replay", str(tmp_path / "none.jsonl"), "--resimulate").code == 2


def test_the_audit_runs_an_intact_log_again(call: Call, folder: Path, tmp_path: Path) -> None:
    log, played = folder / "session.jsonl", str(folder / "one-van.yaml")
    whole = call("replay", str(log), "--verify", "--unsigned", "--scenario", played)
    assert whole.code == 0, whole.said
    assert "chain intact" in whole.said
    assert "of plans are equal" in whole.said
    assert "plans of 1 mission checked again, all equal" in whole.said
    nowhere = call("replay", str(log), "--verify", "--unsigned")
    assert nowhere.code == 1
    assert "not simulated again: " in nowhere.said
    assert "--scenario" in nowhere.said
    only = call("replay", str(log), "--verify", "--unsigned", "--chain-only")
    assert only.code == 0


def test_a_decision_of_other_rules_is_found(call: Call, folder: Path, tmp_path: Path) -> None:
    log = tampered(folder, tmp_path / "f.jsonl", "plan_checked", '"complies"', '"violates"')
    done = resimulate(call, folder, log)
    assert done.code == 1
    assert "of plans are equal" in done.said
    assert "recorded " in done.said
