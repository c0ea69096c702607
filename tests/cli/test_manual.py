"""`pa-console manual`: the list of pages, a page for people, for pipes and for programs."""

import pytest

from pa_console.cli.verbs import manual
from pa_console.manual_pages import load_manual
from pa_console.terminal.output import PlainConsole
from tests.cli.inside import Call


def test_the_pages_are_listed_with_what_they_are_about(call: Call) -> None:
    done = call("manual")
    assert done.code == 0
    pages = load_manual().pages
    for page in pages:
        assert f"{page.name} " in done.out
        assert page.summary in done.said
    assert call("manual", "--json").json == [
        {"name": page.name, "title": page.title, "summary": page.summary} for page in pages
    ]


@pytest.mark.parametrize("words", [(), ("--plain",)])
def test_a_page_in_a_pipe_is_its_markdown(call: Call, words: tuple[str, ...]) -> None:
    done = call("manual", "console", *words)
    assert (done.code, done.out) == (0, load_manual().find("console").text)


def test_a_page_for_programs_names_its_sections(call: Call) -> None:
    page = load_manual().find("glossary")
    told = call("manual", "glossary", "--json").json
    assert (told["name"], told["text"]) == ("glossary", page.text)
    assert told["sections"][0] == page.title


def test_a_page_on_a_terminal_is_laid_out(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = PlainConsole(force_terminal=True, width=80)
    monkeypatch.setattr(manual, "out", terminal)
    monkeypatch.setenv("TERM", "dumb")
    monkeypatch.setenv("LESS", "-R")
    shown = call("manual", "index")
    assert shown.code == 0
    assert load_manual().find("index").title in shown.out
    assert not shown.out.startswith("# ")
    assert call("manual", "index", "--plain").out.startswith("# ")


def test_a_page_that_is_not_there_is_refused_with_what_is_like_it(call: Call) -> None:
    done = call("manual", "consol")
    assert (done.code, done.out) == (2, "")
    assert "no page 'consol'. Did you mean console" in done.err
