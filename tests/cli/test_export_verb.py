"""`pa-console export`: a session opened again by the library of the format."""

import asyncio
import json
import re
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from markdown_it import MarkdownIt
from mcap.reader import make_reader

from pa_console.export.screen_files import ReplayedScreen, film_replay
from pa_console.export.source_log import whole_file, whole_folder
from pa_console.schema.document import Document
from pa_console.schema.incident import Scenario
from pa_console.session.recording import Player
from pa_console.station.assembly import load_site
from tests.cli.inside import Call
from tests.cli.terminal import painted, screen
from tests.cli.test_replay_verb import SCENARIO
from tests.evaluation.sessions import IDENTIFY, RECON, WARN, play
from tests.scripted import ScriptedEngine

pytestmark = pytest.mark.long

QUIET = 10
"""So many events at the end of the session tell little that is new."""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of a session with a mission that an alarm gave."""
    path = tmp_path_factory.mktemp("export") / "session.jsonl"
    played = Document("scenario", SCENARIO).parse(Scenario)
    engine = ScriptedEngine([RECON, IDENTIFY, WARN])
    asyncio.run(play(load_site("checkpoint", "checkpoint"), engine, played, seed=2, log=path))
    return path


def events(log: Path) -> list[dict[str, Any]]:
    """Every record of a log but its signatures."""
    records = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    return [record for record in records if record["kind"] != "log_signed"]


def test_markdown_holds_the_whole_trace(call: Call, log: Path, tmp_path: Path) -> None:
    target = tmp_path / "mission.md"
    done = call("export", "markdown", str(log), "-o", str(target))
    assert done.code == 0, done.err
    text = target.read_text(encoding="utf-8")
    tokens = MarkdownIt("gfm-like").parse(text)
    heads = [tokens[n + 1].content for n, t in enumerate(tokens) if t.type == "heading_open"]
    for head in ("Rules retrieved", "Picture", "Plan", "Checks", "Rehearsal", "Judge", "Decision",
                 "Commands", "Verification", "After-action report", "Outcome"):  # fmt: skip
        assert head in heads, head
    code = "".join(token.content for token in tokens if token.type == "fence")
    recorded = events(log)
    prompts = [e["data"]["user"] for e in recorded if e["kind"] == "prompt_built"]
    assert prompts
    assert all(line in code for line in prompts[0].splitlines())
    hits = [e["data"]["hits"] for e in recorded if e["kind"] == "rules_retrieved"][-1]
    assert all(f"| {hit['rule_id']} | {hit['score']:.3f} |" in text for hit in hits)
    assert call("export", "markdown", str(log)).out == text


def test_a_whole_session_is_a_shift_report_that_begins_with_what_is_open(
    call: Call, log: Path, tmp_path: Path
) -> None:
    lines = log.read_text(encoding="utf-8").splitlines()
    raised = next(n for n, line in enumerate(lines) if '"kind":"approval_requested"' in line)
    cut = tmp_path / "cut.jsonl"
    cut.write_text("\n".join(lines[: raised + 1]) + "\n", encoding="utf-8")
    whole, left = (call("export", "markdown", str(path)).out for path in (log, cut))
    mission = next(e["data"]["mission"] for e in events(log) if e["kind"] == "mission_received")
    heads = re.findall(r"^## (.*)$", whole, re.M)
    assert heads[:4] == ["Left open", "Missions", "Decisions", "Alarms"]
    still_open = f"| mission | {mission['id']} {mission['text']}"
    assert still_open not in whole
    assert still_open in left
    assert re.search(r"\| alarm \| \w+: ", left)
    decided = [e for e in events(log) if e["kind"] == "decision_made"]
    assert whole.count(f"| {mission['id']} | approve |") == len(decided)
    assert f"# Mission {mission['id']}" in whole


def test_a_mission_that_is_not_there_is_told_with_those_that_are(call: Call, log: Path) -> None:
    done = call("export", "markdown", str(log), "--mission", "M404")
    known = [e["mission"] for e in events(log) if e["kind"] == "mission_received"]
    assert done.code == 2
    assert "M404" in done.err
    assert known[0] in done.err


def test_mcap_has_every_event_at_its_time(call: Call, log: Path, tmp_path: Path) -> None:
    target = tmp_path / "session.mcap"
    done = call("export", "mcap", str(log), "--out", str(target))
    assert done.code == 0, done.err
    told: list[tuple[str, int]] = []
    pictures: list[Any] = []
    scene: set[str] = set()
    with target.open("rb") as file:
        reader = make_reader(file)
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            content = json.loads(message.data)
            described = json.loads(schema.data)
            assert "$ref" not in schema.data.decode()
            assert set(content) <= set(described["properties"])
            if channel.topic == "/scene":
                scene |= {entity["id"] for entity in content["entities"]}
            elif channel.topic == "/telemetry":
                told.append(("telemetry", message.log_time))
                pictures.append(content)
            elif channel.topic.startswith("/events/"):
                told.append((content["data"]["kind"], message.log_time))
        metadata = {item.name: item.metadata for item in reader.iter_metadata()}
    recorded = events(log)
    assert sorted(kind for kind, _ in told) == sorted(event["kind"] for event in recorded)
    assert len({when for _, when in told}) == len({event["t"] for event in recorded})
    assert pictures == [e["data"]["picture"] for e in recorded if e["kind"] == "telemetry"]
    assert {"world", *(f"asset {name}" for name in pictures[0]["assets"])} <= scene
    assert metadata["session"]["seed"] == "2"


def test_without_its_package_mcap_says_how_to_get_it(
    call: Call, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    done = call("export", "mcap", str(log), "--out", str(tmp_path / "session.mcap"))
    assert done.code == 2
    assert "[mcap]'" in done.said
    assert not list(tmp_path.glob("*session*"))


def test_svg_screenshots_are_numbered_and_show_the_replay(
    call: Call, log: Path, tmp_path: Path
) -> None:
    target = tmp_path / "pictures"
    kinds = ("--at", "approval_requested", "--at", "mission_finished")
    done = call("export", "svg", str(log), *kinds, "--size", "120x36", "-o", str(target))
    assert done.code == 0, done.err
    wanted = [e["kind"] for e in events(log) if e["kind"] in kinds]
    files = sorted(target.iterdir())
    assert [path.name for path in files] == [
        f"{number:04}-{kind}.svg" for number, kind in enumerate(wanted, start=1)
    ]
    texts = ["".join(ElementTree.parse(path).getroot().itertext()) for path in files]
    assert all("REPLAY" in text for text in texts)
    assert "WAITS FOR YOU" in texts[0].replace("\N{NO-BREAK SPACE}", " ")
    assert "verified" in texts[-1]
    space = "{http://www.w3.org/XML/1998/namespace}space"
    assert {ElementTree.parse(path).getroot().get(space) for path in files} == {"preserve"}
    again = call("export", "svg", str(log), "-o", str(target))
    assert again.code == 2
    assert str(target) in again.err
    wrong = call("export", "svg", str(log), "--at", "lunch", "-o", str(tmp_path / "new"))
    assert wrong.code == 2
    assert "mission_finished" in wrong.err


def test_a_cast_is_a_terminal_recording(call: Call, log: Path, tmp_path: Path) -> None:
    target = tmp_path / "session.cast"
    words = ("--size", "80x24", "--speed", "1", "--fps", "5", "--out", str(target))
    done = call("export", "cast", str(log), *words)
    assert done.code == 0, done.err
    lines = [json.loads(line) for line in target.read_text(encoding="utf-8").splitlines()]
    header, rows = lines[0], lines[1:]
    assert (header["version"], header["width"], header["height"]) == (2, 80, 24)
    times = [row[0] for row in rows]
    assert times == sorted(times)
    assert times[0] == 0.0
    assert {row[1] for row in rows} == {"o", "m"}
    recorded = events(log)
    missions = [e["data"]["mission"] for e in recorded if e["kind"] == "mission_received"]
    assert [row[2] for row in rows if row[1] == "m"] == [f"{m['id']} {m['text']}" for m in missions]
    written = "".join(row[2] for row in rows if row[1] == "o")
    cursors = [(int(row), int(col)) for row, col in re.findall(r"\x1b\[(\d+);(\d+)H", written)]
    assert cursors
    assert all(row <= 24 and col <= 80 for row, col in cursors)
    plain = re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", written)
    assert "REPLAY" in plain
    assert f"event {len(recorded)}" in plain
    assert call("export", "cast", str(log), "--size", "80", "--out", str(target)).code == 2
    assert call("export", "cast", str(log), "--from", "9999", "--out", str(target)).code == 2


async def test_a_shot_tells_only_what_has_changed_and_the_screen_is_whole(log: Path) -> None:
    site, recording = load_site("checkpoint", "checkpoint"), Player.open(log).recording
    told: list[str] = []

    async def shoot(made: ReplayedScreen, *indices: int) -> None:
        for index in indices:
            made.player.to_event(index)
            await made.show()
            told.append(made.written())

    end = len(recording)
    shots = (*range(0, end - QUIET, 4), *range(end - QUIET, end))
    await film_replay(site, Player.open(log), (120, 36), lambda made: shoot(made, *shots))
    assert min(map(painted, told[-QUIET:])) < 120 * 36 / 4
    for number in (9, len(shots) // 2, len(shots) - 1):
        whole = screen("".join(told[: number + 1]))
        at_once = len(told)
        await film_replay(
            site, Player.open(log), (120, 36), lambda made, n=number: shoot(made, shots[n])
        )
        assert whole == screen("".join(told[at_once:]))


async def test_an_interrupted_film_ends(log: Path) -> None:
    shown: list[int] = []

    async def direct(made: ReplayedScreen) -> None:
        task.cancel()
        while True:
            await made.show()
            shown.append(1)

    site = load_site("checkpoint", "checkpoint")
    task = asyncio.create_task(film_replay(site, Player.open(log), (80, 24), direct))
    with pytest.raises(asyncio.CancelledError):
        await task
    assert len(shown) < 3


def test_an_export_never_replaces_its_log(call: Call, log: Path, tmp_path: Path) -> None:
    before = log.read_bytes()
    for format_ in ("markdown", "mcap", "cast"):
        assert call("export", format_, str(log), "--out", str(log)).code == 2
    for target in (tmp_path, tmp_path / "none" / "file"):
        assert call("export", "markdown", str(log), "--out", str(target)).code == 2
    assert log.read_bytes() == before
    assert call("export", "mcap", str(tmp_path / "no.jsonl"), "--out", "x.mcap").code == 2


def test_an_interrupted_export_leaves_what_was_there(log: Path, tmp_path: Path) -> None:
    target = tmp_path / "old.mcap"
    target.write_bytes(b"old")

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), whole_file(target, log) as file:
        interrupt(file.write(b"half"))
    with pytest.raises(KeyboardInterrupt), whole_folder(tmp_path / "new") as folder:
        interrupt((folder / "half.svg").write_text("half"))
    assert [path.name for path in tmp_path.iterdir()] == ["old.mcap"]
    assert target.read_bytes() == b"old"
