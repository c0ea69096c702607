"""The report of an evaluation: complete, of one file, and the same for the same runs."""

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import HealthCheck, given, settings

from pa_console.evaluation.reporting.report import (
    build_tables,
    duration,
    facts,
    markdown_cell,
    notes,
    write_report,
)
from pa_console.evaluation.run_record import RunRecord
from tests.evaluation.records import made_evaluation, made_record, many_records

ABOUT: dict[str, Any] = {"version": "1.2.3", "machine": ["a CPU", "a system"], "seconds": 5400.0}
VOID = frozenset(("meta", "br", "input", "link", "img", "hr"))


class Page(HTMLParser):
    """Collects what a page is made of, and checks that its elements are nested."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.rows = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note ids and links."""
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("src", "href", "xlink:href", "action", "data"):
                self.links.append(value or "")
            if name == "data-marks":
                self.rows += 1

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note those of an element without content."""
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        """Check that the innermost element ends."""
        assert self.open.pop() == tag


def parsed(folder: Path) -> Page:
    page = Page()
    page.feed((folder / "report.html").read_text(encoding="utf-8"))
    page.close()
    assert page.open == []
    return page


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    write_report(folder, made_evaluation(1), ABOUT)
    return folder


def test_the_page_needs_nothing_from_outside(written: Path) -> None:
    page = parsed(written)
    assert page.links
    assert all(link.startswith("#") for link in page.links)
    text = (written / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"url\((?!#)|@import|<(link|img|iframe|script src)\b", text)


def test_ids_of_the_page_are_unique_and_every_reference_has_one(written: Path) -> None:
    page = parsed(written)
    assert len(set(page.ids)) == len(page.ids)
    text = (written / "report.html").read_text(encoding="utf-8")
    used = {link[1:] for link in page.links} | set(re.findall(r"url\(#([^)]+)\)", text))
    assert used <= set(page.ids)


def test_every_run_is_listed_and_every_table_shown(written: Path) -> None:
    records = made_evaluation(1)
    assert parsed(written).rows == len(records)
    html = (written / "report.html").read_text(encoding="utf-8")
    markdown = (written / "report.md").read_text(encoding="utf-8")
    for table in build_tables(records):
        assert f"<h3>{table.title}</h3>" in html
        assert f"### {markdown_cell(table.title)}\n" in markdown


def test_figures_of_the_markdown_lie_beside_it(written: Path) -> None:
    files = re.findall(r"!\[[^]]+\]\(([^)]+)\)", (written / "report.md").read_text("utf-8"))
    assert len(files) == 6
    for file in files:
        assert ElementTree.parse(written / file).getroot().tag.endswith("svg")
        assert (written / file).with_suffix(".png").read_bytes().startswith(b"\x89PNG")


def test_rows_of_markdown_tables_have_as_many_cells_as_their_titles(written: Path) -> None:
    widths: list[int] = []
    for line in (written / "report.md").read_text("utf-8").splitlines():
        if not line.startswith("|"):
            widths = []
            continue
        widths.append(len(re.findall(r"(?<!\\)\|", line)))
        assert widths[-1] == widths[0], line


def test_equal_runs_give_equal_files(written: Path, tmp_path: Path) -> None:
    write_report(tmp_path, made_evaluation(1), ABOUT)
    for path in sorted(written.rglob("*.*")):
        assert (tmp_path / path.relative_to(written)).read_bytes() == path.read_bytes(), path.name


@settings(
    deadline=None,
    max_examples=3,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
@given(records=many_records())
def test_any_runs_can_be_reported(tmp_path: Path, records: list[RunRecord]) -> None:
    write_report(tmp_path, records, {})
    assert parsed(tmp_path).rows == len(records)


def test_what_a_model_writes_stays_text(tmp_path: Path) -> None:
    bad = "<script>alert(1)</script> | $x$ `y` $\\frac"
    write_report(tmp_path, [made_record(model=bad, command=bad, reason=bad, strict=False)], {})
    assert parsed(tmp_path).rows == 1
    assert "<script>alert" not in (tmp_path / "report.html").read_text("utf-8")


def test_no_runs_give_a_report_that_says_so(tmp_path: Path) -> None:
    write_report(tmp_path, [], {})
    assert "There are no runs yet." in (tmp_path / "report.md").read_text("utf-8")


def test_facts_tell_what_was_run_and_on_what() -> None:
    told = dict(facts(made_evaluation(1), ABOUT))
    assert told["mission sets"] == "paper (10 missions), field (4 missions)"
    assert (told["machine"], told["time taken"]) == ("a CPU; a system", "1 h 30 min")
    assert "no-judge: one-plan without the judge" in told["variants"]


def test_notes_warn_of_what_weakens_the_figures() -> None:
    records = [
        made_record(),
        made_record(seed=1, model="other", reused=2, judge_outcome=None, strict=False),
    ]
    text = " ".join(notes(records, {"jobs": 2}))
    assert "Not every model has run the same missions" in text
    assert "1 of 2 runs reused an answer" in text
    assert "1 of 2 runs have no verdict" in text
    assert "2 runs were made at a time" in text


@pytest.mark.parametrize(
    ("seconds", "text"), [(5, "5 s"), (600, "10 min"), (3570, "1 h 0 min"), (7260, "2 h 1 min")]
)
def test_times_are_told_in_hours(seconds: float, text: str) -> None:
    assert duration(seconds) == text
