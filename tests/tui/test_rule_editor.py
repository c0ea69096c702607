"""A rule is edited in the policy browser: checked, tried, saved; nothing typed is ever lost."""

import sys
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import OptionList, Static, TextArea

from pa_console.policy.retriever import Retriever
from pa_console.policy.rule_seal import sign_rules
from pa_console.policy.rulebook import Rulebook, load_rules, read_rule_set
from pa_console.schema.events.event import EventPayload, Noticed, RulesReplaced
from pa_console.signing import KEY_VARIABLE, load_signer
from pa_console.tui.app import ConsoleApp
from pa_console.tui.screens.dialogs import Confirm
from pa_console.tui.screens.policies import PolicyScreen
from pa_console.tui.screens.rule_editor import RuleEditor
from pa_console.tui.terminal import editor_command
from pa_console.tui.widgets.row_views import TextRows
from tests.tui import story
from tests.tui.scripted import ScriptedStation, console, notices, press, settle, until

pytestmark = pytest.mark.long

RULES = """\
# The rules of the house.
name: house
rules:
  # Blocked blind.
  - id: ROE-02
    domain: ROE
    priority: critical
    text: "Unknown vehicles or persons must be identified before escalation."
    check: |-
      actions
        .filter(a, a.verb == 'block')
        .map(a, a.agent)
    message: "blocks"
    examples:
      - name: reports
        expect: pass
        plan: [[Robot_T01, report]]
      - name: blocks
        expect: fail
        plan: [[Ugv_T01, block EastGate]]

  - id: WF-03
    domain: WF
    priority: high
    text: "Maintain at least one asset assigned to each gate at all times."   # cover
    check: "world.gates.all(g, after.gates[g].covered)"
    message: "a gate is left without cover"
"""
SIZE = (120, 36)


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    path = tmp_path / "house.yaml"
    path.write_text(RULES)
    return path


def opened(
    rules: Path, payloads: list[EventPayload] | None = None, **options: Any
) -> tuple[ConsoleApp, ScriptedStation]:
    """Return a console with the rules of the file in force, and its station."""
    station = ScriptedStation(payloads or story.opening())
    app = console(station, rules.parent, rules_file=rules, **options)
    app.controllers.rules.rulebook = load_rules(rules)
    return app, station


async def browse(pilot: Pilot[Any], *keys: str) -> PolicyScreen:
    """Open the browser with the pointer in its list."""
    await settle(pilot)
    await press(pilot, "f6")
    screen = pilot.app.screen
    assert isinstance(screen, PolicyScreen)
    screen.query_one("#policy-list").focus()
    await pilot.press(*keys)
    await pilot.pause()
    return screen


async def edit(pilot: Pilot[Any], *keys: str) -> RuleEditor:
    """Open the editor on the rule that `keys` lead to, and wait until it was checked."""
    await browse(pilot, *keys)
    await until(pilot, lambda: isinstance(pilot.app.screen, RuleEditor))
    screen = pilot.app.screen
    assert isinstance(screen, RuleEditor)
    await until(pilot, lambda: screen.checked)
    return screen


@asynccontextmanager
async def editing(
    rules: Path, *keys: str, payloads: list[EventPayload] | None = None
) -> AsyncGenerator[tuple[ConsoleApp, Pilot[Any], ScriptedStation, RuleEditor], None]:
    """Open a console with the editor on the rule that `keys` lead to."""
    app, station = opened(rules, payloads)
    async with app.run_test(size=SIZE) as pilot:
        yield app, pilot, station, await edit(pilot, *keys)


async def write(pilot: Pilot[Any], editor: RuleEditor, old: str, new: str) -> None:
    """Change the text, and wait until what it is now was checked."""
    area = editor.query_one(TextArea)
    assert old in area.text
    area.text = area.text.replace(old, new)
    await pilot.pause()
    await until(pilot, lambda: editor.checked)


def plain(shown: object) -> str:
    """Return what is shown without its line breaks."""
    return " ".join(str(shown).split())


def said(editor: RuleEditor) -> str:
    return plain(editor.query_one("#rule-status", Static).render())


def results(editor: RuleEditor) -> str:
    return plain(editor.query_one("#rule-sheet", TextRows).render())


async def answer(pilot: Pilot[Any], key: str) -> str:
    """Answer the question that comes up; return it."""
    await until(pilot, lambda: isinstance(pilot.app.screen, Confirm))
    await until(pilot, lambda: pilot.app.screen.query(Static))
    question = plain(pilot.app.screen.query_one(Static).render())
    await pilot.press(key)
    await pilot.pause()
    return question


def listing(app: ConsoleApp) -> OptionList:
    return app.screen.query_one("#policy-list", OptionList)


async def test_a_rule_is_checked_as_it_is_typed_and_saved_alone(rules: Path) -> None:
    async with editing(rules, "e") as (app, pilot, station, editor):
        assert editor.text.startswith("# Blocked blind.\nid: ROE-02\n")
        assert "compiles, 2 examples right" in said(editor)
        await write(pilot, editor, "== 'block'", "= 'block'")
        assert "line 8, column 23: check: not valid CEL" in said(editor)
        await pilot.press("ctrl+g")
        assert editor.query_one(TextArea).cursor_location == (7, 22)
        await pilot.press("ctrl+s")
        await pilot.pause()
        assert rules.read_text() == RULES
        await write(pilot, editor, "= 'block'", "== 'warn'")
        assert "1 of 2 examples wrong" in said(editor)
        assert "blocks must be broken, but holds" in results(editor)
        await write(pilot, editor, "'warn'", "'block' && true")
        await pilot.press("ctrl+s")
        await until(pilot, lambda: station.reloads)
        assert rules.read_text() == RULES.replace("== 'block'", "== 'block' && true")
        assert not app.controllers.rules.bench.drafts


async def test_a_draft_outlives_the_editor_and_can_be_discarded(rules: Path) -> None:
    async with editing(rules, "down", "enter") as (app, pilot, _, editor):
        await write(pilot, editor, "high", "medium")
        await pilot.press("escape")
        await until(pilot, lambda: isinstance(app.screen, PolicyScreen))
        await settle(pilot)
        option = listing(app).get_option_at_index(1)
        assert "✎WF-03" in str(option.prompt)
        await pilot.press("e")
        await until(pilot, lambda: app.screen.query("#rule-text"))
        again = app.screen
        assert isinstance(again, RuleEditor)
        assert "priority: medium" in again.text
        await pilot.press("ctrl+r")
        assert "Discard" in await answer(pilot, "y")
        await until(pilot, lambda: "priority: high" in again.text)
        assert rules.read_text() == RULES


async def test_a_draft_outlives_the_console_until_it_is_saved(rules: Path) -> None:
    async with editing(rules, "down", "e") as (app, pilot, station, editor):
        await write(pilot, editor, "high", "medium")
        kept = {path: path.read_bytes() for path in rules.parent.glob("drafts/*")}
    assert len(kept) == 1, "what is typed is on the disk before the console is left"
    async with editing(rules, "down", "e") as (app, pilot, station, editor):
        assert "priority: medium" in editor.text
        await pilot.press("ctrl+s")
        await until(pilot, lambda: station.reloads)
    assert "priority: medium" in rules.read_text()
    assert not app.controllers.rules.bench.drafts
    assert not list(rules.parent.glob("drafts/*"))
    for path, content in kept.items():
        path.write_bytes(content[:-9])
    app, _ = opened(rules)
    assert not app.controllers.rules.bench.drafts, (
        "a file that is cut short is no draft, and no error"
    )


async def test_a_file_changed_meanwhile_is_asked_about(rules: Path) -> None:
    app, station = opened(rules)
    theirs = RULES.replace("# cover", "# theirs")
    async with app.run_test(size=SIZE) as pilot:
        editor = await edit(pilot, "e")
        await write(pilot, editor, "message: ", "message:  ")
        rules.write_text(theirs)
        await pilot.press("ctrl+s")
        assert "has changed in the meantime, but not this rule" in await answer(pilot, "n")
        assert rules.read_text() == theirs
        assert app.controllers.rules.bench.drafts
        await pilot.press("ctrl+s")
        await answer(pilot, "y")
        await until(pilot, lambda: station.reloads)
        assert rules.read_text() == theirs.replace('message: "blocks"', 'message:  "blocks"')


async def test_a_file_that_cannot_be_written_leaves_the_draft(rules: Path) -> None:
    async with editing(rules, "e") as (app, pilot, _, editor):
        await write(pilot, editor, "critical", "high")
        rules.chmod(0o444)
        await pilot.press("ctrl+s")
        await until(pilot, lambda: notices(app))
        assert "the file is read-only. The draft is kept" in notices(app)[0]
        assert rules.read_text() == RULES
        assert "priority: high" in app.controllers.rules.bench.drafts["ROE-02"][1]


async def test_a_signed_set_is_said_to_be_altered_and_can_be_signed_anew(
    rules: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(KEY_VARIABLE, str(rules.parent / "mine.pem"))
    sign_rules(rules, read_rule_set(rules)[1], load_signer())
    async with editing(rules, "e") as (app, pilot, station, editor):
        await write(pilot, editor, "critical", "high")
        await pilot.press("ctrl+s")
        assert "has changed since" in await answer(pilot, "y")
        await until(pilot, lambda: station.reloads)
        app.controllers.rules.rulebook = load_rules(rules)
        assert app.controllers.rules.rulebook.seal.standing == "own key"
        monkeypatch.setenv(KEY_VARIABLE, str(rules.parent / "other.pem"))
        app.controllers.rules.rulebook = load_rules(rules)
        await write(pilot, editor, "priority: high", "priority: medium")
        await pilot.press("ctrl+s")
        assert "signed by an unknown key. Saving makes it ALTERED" in await answer(pilot, "n")
        assert "priority: high" in rules.read_text()


async def test_a_rule_is_added_without_python_and_removed_after_a_question(rules: Path) -> None:
    async with editing(rules, "down", "n") as (app, pilot, station, editor):
        assert "id: WF-04" in editor.text
        assert "compiles, 2 examples right" in said(editor)
        await pilot.press("ctrl+s")
        await until(pilot, lambda: station.reloads == 1)
        assert rules.read_text().startswith(RULES)
        book = load_rules(rules)
        assert [rule.id for rule in book.rules] == ["ROE-02", "WF-03", "WF-04"]
        await pilot.press("escape")
        await until(pilot, lambda: isinstance(app.screen, PolicyScreen))
        replaced(station, book, "WF-04 added")
        await settle(pilot)
        await until(pilot, lambda: listing(app).option_count == 3)
        listing(app).highlighted = 2
        await pilot.press("delete")
        assert "Remove WF-04" in await answer(pilot, "y")
        await until(pilot, lambda: station.reloads == 2)
        assert [rule.id for rule in load_rules(rules).rules] == ["ROE-02", "WF-03"]


def replaced(station: ScriptedStation, book: Rulebook, *changes: str) -> None:
    """Let the station say that `book` is in force now."""
    assert book.rule_set is not None
    station.retriever = Retriever(book.rules)
    station.emit(
        RulesReplaced(rules=book.name, rules_sha256=book.sha256, rules_seal=book.seal,
                      changes=changes, rule_set=book.rule_set),
        mission=None,
    )  # fmt: skip


async def test_the_browser_shows_the_set_that_came_into_force(rules: Path) -> None:
    app, station = opened(rules)
    async with app.run_test(size=SIZE) as pilot:
        screen = await browse(pilot, "down")
        rules.write_text(RULES.replace("at all times", "always"))
        replaced(station, load_rules(rules), "WF-03 changed")
        station.emit(Noticed(level="alarm", subject="rules", text="not taken"), mission=None)
        await settle(pilot)
        await until(pilot, lambda: "always" in str(screen.query_one(TextRows).render()))
        assert notices(app) == ["not taken"]
        assert app.controllers.rules.rulebook.seal == load_rules(rules).seal


async def test_the_console_searches_what_the_station_has_indexed(rules: Path) -> None:
    app, station = opened(rules)
    async with app.run_test(size=SIZE) as pilot:
        await browse(pilot)
        rules.write_text(RULES.replace("at all times", "always"))
        replaced(station, load_rules(rules), "WF-03 changed")
        await settle(pilot)
        await until(pilot, lambda: app.controllers.rules.retriever is station.retriever)


async def test_a_draft_is_tried_on_the_plans_of_the_session_and_the_present(rules: Path) -> None:
    async with editing(rules, "e", payloads=story.told("approval")) as (
        _,
        pilot,
        _,
        editor,
    ):
        for words in ("now, no asset moves: ✔ complies", "now, the last plan (M-003): ✔ complies",
                      "M-003 #1: ✔ complies"):  # fmt: skip
            assert words in results(editor)
        await write(pilot, editor, "== 'block'", "== 'identify'")
        assert "M-003 #1: ✘ VIOLATES blocks: Robot_T01 was: complies" in results(editor)


async def test_a_rule_leads_to_the_missions_it_had_to_do_with(rules: Path) -> None:
    app, _ = opened(rules, story.told("approval", broken=("WF-03",)))
    async with app.run_test(size=SIZE) as pilot:
        screen = await browse(pilot, "down")
        text = plain(screen.query_one(TextRows).render())
        assert "in this session M-003 Have a look" in text
        assert "retrieved 0.38 #1 ✘ VIOLATES a gate is left without cover" in text
        await pilot.press("m")
        await until(pilot, lambda: app.screen is app.session.main)
        assert app.session.main is not None
        assert app.session.main.has_class("-view-trace")


async def test_a_read_only_console_edits_nothing(rules: Path) -> None:
    app, _ = opened(rules, readonly=True)
    async with app.run_test(size=SIZE) as pilot:
        screen = await browse(pilot, "e", "n", "delete")
        await pilot.pause()
        assert app.screen is screen
        assert set(notices(app)) == {"the console is read-only"}


async def test_without_a_terminal_of_its_own_the_editor_is_not_begun(
    rules: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    app, _ = opened(rules)
    monkeypatch.setenv("VISUAL", f"{sys.executable} -c pass")
    async with app.run_test(size=SIZE) as pilot:
        editor = await edit(pilot, "e")
        before = editor.text
        await pilot.press("ctrl+o")
        await until(pilot, lambda: notices(app))
        assert notices(app) == ["this terminal cannot be given to another program"]
        assert editor.text == before


@pytest.mark.parametrize("command", ["no-such-editor -w", '"'])
def test_an_editor_that_is_not_there_is_named(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VISUAL", command)
    with pytest.raises(ValueError, match="set VISUAL or EDITOR"):
        editor_command()


@pytest.mark.parametrize("size", [(80, 24), (120, 36)])
def test_screen(snap_compare: Callable[..., bool], rules: Path, size: tuple[int, int]) -> None:
    app, _ = opened(rules, story.told("approval"))

    async def run(pilot: Pilot[Any]) -> None:
        editor = await edit(pilot, "e")
        await write(pilot, editor, "== 'block'", "== 'identify'")
        editor.query_one("#rule-title", Static).update("Rule ROE-02  ✎ not saved")

    assert snap_compare(app, terminal_size=size, run_before=run)
