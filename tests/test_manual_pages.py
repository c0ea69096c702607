"""The manual's pages: how they are found, named and searched."""

from pathlib import Path

import pytest

import pa_console
from pa_console.manual_pages import FIRST, Manual, linked_pages, load_manual, read_page
from tests.glossary import HEADING, retired_words, uses

MOST_WORDS = 2500
README = Path(pa_console.__file__).parents[1] / "README.md"

RULES = """# Rules of engagement

![A picture of a rule](rule.svg)

A rule says what must hold, e.g. at a gate. It has an id.

## Signing

The file is signed with `pa-console rules sign`; a **broken** seal is
told on [every screen](console.md#alarms).

```
# no heading
pa-console rules pin
```

## Fields

| field | what it is |
|---|---|
| `check` | an expression that must hold |
"""


MANUAL = Manual(
    (
        read_page("rules", RULES),
        read_page("console", "# Console\n\nSigning out is easy.\n\n## Alarms\n\nSeen or new.\n"),
    )
)


def test_every_page_has_a_title_and_begins_with_a_sentence() -> None:
    found = load_manual().pages
    assert found[0].name == FIRST
    for page in found:
        assert page.text.startswith(f"# {page.title}\n"), page.name
        assert page.summary.endswith((".", "!", "?")), page.name


def test_a_page_can_be_read_in_a_quarter_of_an_hour() -> None:
    pages = {page.name: len(page.text.split()) for page in load_manual().pages}
    history = pages.pop("changelog")
    assert history
    assert {name: words for name, words in pages.items() if words > MOST_WORDS} == {}


def test_the_newcomer_s_path_comes_first() -> None:
    names = [page.name for page in load_manual().pages]
    assert names[:4] == ["index", "start", "approval", "days-work"]


def test_no_page_uses_a_word_that_the_glossary_has_retired() -> None:
    pages = {page.name: page.text.partition(HEADING)[0] for page in load_manual().pages}
    pages["README"] = README.read_text(encoding="utf-8")
    retired = retired_words()
    assert len(retired) > 10
    assert [
        (name, word) for name, text in pages.items() for word in retired if uses(text, word)
    ] == []


def test_every_link_between_pages_leads_to_one() -> None:
    found = load_manual().pages
    for page in found:
        assert set(linked_pages(page.text)) <= {one.name for one in found}, page.name


def test_a_page_is_called_by_its_title_and_described_by_its_first_sentence() -> None:
    page = read_page("rules", RULES)
    assert page.title == "Rules of engagement"
    assert page.summary == "A rule says what must hold, e.g. at a gate."


def test_a_page_without_a_heading_is_called_by_its_name() -> None:
    assert read_page("odd", "Some words.").title == "odd"


def test_the_sections_of_a_page_are_its_headings_and_hold_its_words_without_marks() -> None:
    sections = read_page("rules", RULES).sections
    assert [section.heading for section in sections] == ["Rules of engagement", "Signing", "Fields"]
    assert sections[1].text == (
        "The file is signed with pa-console rules sign; a broken seal is told on every screen. "
        "# no heading pa-console rules pin"
    )
    assert sections[2].text == "field what it is check an expression that must hold"


def test_the_anchor_of_a_link_means_a_heading() -> None:
    page = read_page("rules", "# Rules\n\n## What `pin`, if anything, does\n\n## Fields\n")
    assert page.heading_of("what-pin-if-anything-does") == 1
    assert page.heading_of("fields") == 2
    assert page.heading_of("") == page.heading_of("elsewhere") == 0


def test_words_are_found_in_any_order_and_case_headings_first() -> None:
    assert [(one.page.name, one.heading) for one in MANUAL.search("SIGN")] == [
        ("rules", "Signing"),
        ("console", "Console"),
    ]
    (found,) = MANUAL.search("seal Broken")
    assert (found.page.name, found.number) == ("rules", 1)
    assert "broken seal" in found.excerpt
    assert MANUAL.search("seal moon") == []
    assert MANUAL.search("  ") == []


@pytest.mark.parametrize("topic", ["rules", "Rules", "rules.md"])
def test_a_page_is_found_by_its_name(topic: str) -> None:
    assert MANUAL.find(topic).name == "rules"


@pytest.mark.parametrize(
    ("topic", "page"),
    [
        ("alarms", "console"),
        ("Signing", "rules"),
        ("scenarios", "worlds"),
        ("training", "evaluation"),
    ],
)
def test_a_page_is_found_by_the_heading_of_a_section(topic: str, page: str) -> None:
    manual = MANUAL if page in ("console", "rules") else load_manual()
    assert manual.find(topic).name == page


def test_a_page_that_is_not_there_is_named_with_what_is_like_it() -> None:
    with pytest.raises(ValueError, match=r"no page 'ruls'\. Did you mean rules"):
        MANUAL.find("ruls")
    with pytest.raises(ValueError, match=r"no page 'zzzz'\. Pages: rules, console"):
        MANUAL.find("zzzz")
