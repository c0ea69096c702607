"""Nothing that a terminal obeys comes out raw, whichever of the program's outputs it is.

The loader refuses such text in files; it is switched off here, so that every output is seen to
hold by itself. Session logs hold the true text.
"""

import io
import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, cast

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from rich.markdown import Markdown
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from pa_console.cli.verbs import models
from pa_console.evaluation.run_record import RUNS
from pa_console.llm.models.catalogue import Catalog
from pa_console.resources import find_data
from pa_console.schema import document
from pa_console.schema.document import Document, DocumentError
from pa_console.schema.events.event import Event
from pa_console.schema.text import obeyed, visible, visible_json
from pa_console.session.recording import Player
from pa_console.terminal.output import PlainConsole
from pa_console.tui.app import ConsoleApp
from tests.cli.inside import Call
from tests.evaluation.records import made_record
from tests.session.logs import write_log
from tests.tui import story
from tests.tui.scripted import ScriptedStation, console, settle
from tests.tui.story import stamped

PIECES = (
    "\x1b]52;c;aGk=\x07", "\x1b[31;5m", "\x1bPq\x1b\\", "\x9b31m", "\x9d52;c;aGk=\x9c",
    "\x85", "\r", "\x08", "\x0c", "\x7f", "\x00", "\u061c", "\u200b", "\u200d", "\u200e", "\u2028",
    "\u202e", "\u2060", "\u2066", "\ufeff", "\u00ad", "\U000e0041", "\U000e007f",
)  # fmt: skip
PAYLOAD = "".join(PIECES) + "[/x][bold red]]"
_OWN = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
"""What the terminal library writes by itself."""
_RAW = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u00ad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff"
    "\U000e0000-\U000e007f\ud800-\udfff]"
)


def raw(written: str) -> list[str]:
    """Return what of the payload, or of anything like it, stands in what was written."""
    found = [piece for piece in PIECES if piece in written]
    return found + [ascii(match) for match in _RAW.findall(_OWN.sub("", written))]


def hostile(events: Iterable[Event]) -> list[Event]:
    """Return the events with the payload after every text that may be any text."""
    return [_hostile_event(event) for event in events]


def _hostile_event(event: Event) -> Event:
    document = event.model_dump(mode="json")
    for place, key in list(_texts(document["data"])):
        before = place[key]
        place[key] = before + PAYLOAD
        try:
            Event.model_validate(document, strict=False)
        except ValidationError:
            place[key] = before
    return Event.model_validate(document, strict=False)


def _texts(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield where every text stands but ids and what events are told apart by."""
    keys = cast(dict[str, Any], value) if isinstance(value, dict) else range(len(value))
    for key in list[Any](keys):
        if isinstance(value[key], str):
            if key not in ("kind", "session", "id", "mission_id", "rule_id", "world", "rules"):
                yield value, key
        elif isinstance(value[key], dict | list):
            yield from _texts(value[key])


pytestmark = pytest.mark.long

UNSEEN_ONLY = ("\u200b", "\u200d", "\u2060", "\ufeff", "\u00ad")
"""Pieces that join or part letters in honest text: a file may hold them, and they are shown."""
MISSION = "Go [/x]\x1b]52;c;aGk=\x07\u202e"
SHOWN = re.compile(r"\\(x1b|x9b|x85|x7f|u20|u061c|U000e)")
"""How pieces of the payload are seen; a narrow column may break some of them."""
SHOWING = [
    ["rules", "list"], ["rules", "check"], ["rules", "trace"], ["scenarios", "list"],
    ["scenarios", "show"], ["export", "markdown"], ["export", "svg"], ["export", "cast"],
    ["eval", "report"], ["settings", "show"], ["models", "list"], ["mission", MISSION],
]  # fmt: skip
"""Verbs that tell the hostile text itself."""
WORLD = find_data("worlds", "checkpoint", "world.yaml")
RULES: dict[str, Any] = {
    "name": f"own {PAYLOAD}",
    "source": PAYLOAD,
    "rules": [
        {
            "id": "ROE-01", "domain": "ROE", "priority": "critical", "tags": [f"tag{PAYLOAD}"],
            "text": f"Do not use lethal force. {PAYLOAD}", "check": "size(actions) < 9",
            "message": f"too many {PAYLOAD}",
            "examples": [
                {"name": f"one {PAYLOAD}", "expect": "fail", "plan": [["Drone_T04", "hold"]]}
            ],
        },
        {"id": "WF-01", "domain": "WF", "priority": "medium", "text": f"Report. {PAYLOAD}"},
    ],
}  # fmt: skip


@pytest.fixture
def call(call: Call, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Return what runs a verb in this process, with the loader's own gate open."""

    def nothing(text: str) -> str:
        return text[:0]

    monkeypatch.setattr(document, "obeyed", nothing)
    return call


@pytest.fixture
def rules(tmp_path: Path) -> str:
    path = tmp_path / "rules.yaml"
    path.write_text(yaml.safe_dump(RULES))
    return str(path)


@pytest.fixture
def world(tmp_path: Path) -> str:
    """Return a world with a hostile title, and a hostile scenario beside it."""
    path = tmp_path / "world" / "world.yaml"
    (path.parent / "scenarios").mkdir(parents=True)
    content = yaml.safe_load(WORLD.read_text(encoding="utf-8")) | {"title": PAYLOAD}
    path.write_text(yaml.safe_dump(content))
    scenario = {
        "name": "own", "title": f"Own {PAYLOAD}", "about": PAYLOAD,
        "events": [{"at_s": 1, "do": {"kind": "spawn", "gate": "WestGate"}}],
    }  # fmt: skip
    (path.parent / "scenarios" / "own.yaml").write_text(yaml.safe_dump(scenario))
    return str(path)


@pytest.fixture
def log(tmp_path: Path) -> str:
    """Return a forged log: sound in its form, hostile in every text."""
    path = tmp_path / "forged [/x].jsonl"
    return str(write_log(path, hostile(kept()), story.STARTED.session))


Places = dict[str, str]


@pytest.fixture
def places(
    rules: str, world: str, log: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Places:
    """Return the files that the verbs are given; settings and catalogue are hostile as well."""
    hostile_settings(tmp_path, monkeypatch)
    hostile_catalogue(monkeypatch)
    runs = tmp_path / "runs"
    runs.mkdir()
    made = made_record(category=PAYLOAD, command=PAYLOAD, reason=PAYLOAD, model=f"m{PAYLOAD}")
    (runs / RUNS).write_text(made.model_dump_json() + "\n", encoding="utf-8")
    other = write_log(tmp_path / "other.jsonl", kept(), story.STARTED.session)
    return {
        "RULES": rules, "WORLD": world, "LOG": log, "OTHER": str(other), "RUNS": str(runs),
        "OUT": str(tmp_path / "out.file"), "FOLDER": str(tmp_path / "pictures"),
    }  # fmt: skip


def kept() -> list[Event]:
    return [event for event in stamped(story.told("finished")) if not event.data.transient]


def test_the_log_keeps_the_true_text(log: str) -> None:
    records = [json.loads(line) for line in Path(log).read_text(encoding="utf-8").split("\n")[:-1]]
    missions = [record for record in records if record["kind"] == "mission_received"]
    assert missions[0]["data"]["mission"]["text"].endswith(PAYLOAD)


@pytest.mark.parametrize(
    "words",
    [
        ["rules", "list", "--rules", "RULES"],
        ["rules", "list", "--rules", "RULES", "--json"],
        ["rules", "search", f"lethal {PAYLOAD.replace(chr(0), '')}", "--rules", "RULES"],
        ["rules", "search", "lethal force", "--rules", "RULES", "--json"],
        ["rules", "check", "RULES"],
        ["rules", "check", "RULES", "--json"],
        ["rules", "lint", "RULES"],
        ["rules", "diff", "RULES", "checkpoint"],
        ["rules", "trace", "ROE-01", "LOG", "--all"],
        ["rules", "trace", "ROE-01", "LOG", "--json"],
        ["world", "check", "WORLD"],
        ["scenarios", "list", "--world", "WORLD"],
        ["scenarios", "list", "--world", "WORLD", "--json"],
        ["scenarios", "show", "own", "--world", "WORLD"],
        ["replay", "LOG", "--verify", "--chain-only", "--unsigned"],
        ["replay", "LOG", "--verify", "--chain-only", "--unsigned", "--json"],
        ["replay", "LOG", "--compare", "OTHER"],
        ["replay", "LOG", "--resimulate"],
        ["export", "markdown", "LOG"],
        ["export", "markdown", "LOG", "-o", "OUT"],
        ["export", "svg", "LOG", "--world", "checkpoint", "--rules", "checkpoint", "-o", "FOLDER"],
        ["export", "cast", "LOG", "--world", "checkpoint", "--rules", "checkpoint", "-o", "OUT"],
        ["eval", "report", "RUNS"],
        ["eval", "report", "RUNS", "--json"],
        ["settings", "show"],
        ["settings", "show", "--json"],
        ["models", "list"],
        ["models", "list", "--json"],
        ["doctor", "--json"],
        ["mission", MISSION, "--rules", "RULES", "--model", "/no\x1b[5m"],
        ["no\x1b[5m verb [/x]\u202e"],
    ],
    ids=lambda words: " ".join(words[:2]) if words[0].isalpha() else "no verb",
)
def test_no_verb_prints_or_writes_it_raw(call: Call, words: list[str], places: Places) -> None:
    done = call(*(places.get(word, word) for word in words))
    files = [Path(places["OUT"]), *Path(places["FOLDER"]).glob("*.svg")]
    files += Path(places["RUNS"]).glob("report.*")
    files += Path(places["RUNS"]).glob("**/*.svg")
    written = [done.out, done.err]
    written += [file.read_text(encoding="utf-8") for file in files if file.is_file()]
    assert not [found for text in written for found in raw(text)]
    if words[-1] == "--json" and done.out:
        assert isinstance(done.json, dict | list)
    if words[:2] in SHOWING:
        assert any(SHOWN.search(text) for text in written), done


def hostile_settings(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the user's settings name a folder with the payload in its name."""
    file = folder / "settings.yaml"
    file.write_text(yaml.safe_dump({"logs": f"/tmp/{PAYLOAD.replace(chr(0), '')}"}))
    monkeypatch.setenv("PA_CONSOLE_SETTINGS", str(file))


def hostile_catalogue(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every model of the catalogue have a hostile title and notes."""
    loaded = Catalog.load()
    told = {"title": PAYLOAD, "notes": PAYLOAD}
    changed = loaded.model_copy(
        update={"models": tuple(entry.model_copy(update=told) for entry in loaded.models)}
    )

    def load() -> Catalog:
        return changed

    monkeypatch.setattr(models.Catalog, "load", load)


async def drawn(app: ConsoleApp) -> str:
    """Return the text of every line as it goes to the terminal."""
    strips = app.screen._compositor.render_strips()  # pyright: ignore[reportPrivateUsage]
    return "\n".join(strip.text for strip in strips)


@pytest.mark.parametrize("step", story.STEPS)
async def test_no_pane_shows_it_raw(step: str, tmp_path: Path) -> None:
    told = [event.data for event in hostile(stamped(story.told(step)))]
    station = ScriptedStation(told)
    app = console(station, tmp_path)
    seen: list[str] = []
    async with app.run_test(size=(120, 36)) as pilot:
        await settle(pilot)
        for keys in (("f4",), ("f5",), ("f3",), ("f2",), ("f1",), ("escape",), ("f6",)):
            await pilot.press(*keys)
            await settle(pilot)
            seen += [await drawn(app), app.export_screenshot(title="own")]
        app.notify(PAYLOAD, title=PAYLOAD, markup=False)
        await settle(pilot)
        seen.append(await drawn(app))
    assert not [found for text in seen for found in raw(text)]
    assert any(SHOWN.search(text) for text in seen)


async def test_no_replay_shows_it_raw(tmp_path: Path) -> None:
    app = console(None, tmp_path, player=Player.of(hostile(kept())))
    seen: list[str] = []
    async with app.run_test(size=(120, 36)) as pilot:
        await settle(pilot)
        for keys in (("G",), (*"end", "enter"), ("f4",), ("slash",), tuple("lethal"), ("escape",)):
            await pilot.press(*keys)
            await settle(pilot)
            seen.append(await drawn(app))
    assert not [found for text in seen for found in raw(text)]
    assert any(SHOWN.search(text) for text in seen)


WORDS = st.lists(st.sampled_from((*PIECES, "a", "[/x]", "[bold]", " ", "\n", "\t", "é", "日"))).map(
    "".join
)


@given(WORDS, st.integers(4, 60))
@settings(deadline=None)
def test_the_console_of_the_command_line_lets_nothing_through(text: str, width: int) -> None:
    table = Table("a", text)
    table.add_row(text, Text(text))
    written = io.StringIO()
    printer = PlainConsole(file=written, width=width, force_terminal=True)
    for shown in (text, Text(text), table, Panel(text, title=Text(text)), Markdown(text)):
        printer.print(shown)
        printer.print(shown, soft_wrap=True, style="bold")
    with printer.status(text) as status:
        status.update(text)
    assert not raw(re.sub(r"[\r]|\x1b\]8;[^\x1b]*\x1b\\", "", written.getvalue()))


@given(st.text() | WORDS)
@settings(deadline=None)
def test_json_means_the_same_and_is_plain(text: str) -> None:
    written = visible_json(json.dumps({text: [text]}, ensure_ascii=False, indent=1))
    assert json.loads(written) == {text: [text]}
    assert not raw(written)


@given(st.text() | WORDS)
@settings(deadline=None)
def test_what_is_visible_stays_and_the_rest_is_told_apart(text: str) -> None:
    shown = visible(text)
    assert not raw(shown)
    assert visible(shown) == shown
    if not raw(text):
        assert obeyed(text) == ""


@pytest.mark.parametrize(
    "piece",
    [piece for piece in PIECES if piece not in ("\u200b", "\u200d", "\u2060", "\ufeff", "\u00ad")],
)
def test_no_file_holds_what_a_terminal_obeys(piece: str) -> None:
    text = yaml.safe_dump({"rules": [{"text": f"No {piece} force."}]})
    with pytest.raises(DocumentError, match=r"rules\.0\.text: contains U\+.*remove it") as refused:
        Document("rules.yaml", text)
    assert refused.value.line == 2
    assert not raw(str(refused.value))
