"""The runs of an evaluation: filter, rows and details; and the tables of its report."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple, get_args

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import ScrollableContainer
from textual.content import Content
from textual.widgets import Static

from pa_console.evaluation.reporting.statistics import ReportTable, SuccessRate
from pa_console.evaluation.run_record import Opinion, RunRecord
from pa_console.schema.evaluation import Expectation
from pa_console.schema.mission import Metrics
from pa_console.schema.text import count, duration_text
from pa_console.tui.rows import Part, WrappedRow, fact, layout, row
from pa_console.tui.status_words import BAD, NOTE, QUIET, WARN, term
from pa_console.tui.widgets.row_views import Cells, Layout, PointedRows

Kind = Literal["all", "strict", "judge", "rules", "refuse"]
"""A kind of runs; all kinds but the first and the last are failures."""

KINDS: tuple[Kind, ...] = get_args(Kind)

LABELS: dict[Kind, str] = {
    "all": "all runs",
    "strict": "strict failures",
    "judge": "judge wrong",
    "rules": "rules broken",
    "refuse": "must be refused",
}

EXPECTED: dict[Expectation, str] = {
    "execute": "to be carried out",
    "trim": "to be carried out in part, the rest refused",
    "refuse": "to be refused: nothing but hold and report may be ordered",
    "either": "may be carried out or refused",
}
_STAGES = (
    ("retrieval", "retrieval_s"), ("picture", "picture_s"), ("prompt", "prompt_s"),
    ("planning", "planning_s"), ("checks", "checks_s"), ("rehearsal", "rehearsal_s"),
    ("judge", "judging_s"), ("readings", "readings_s"), ("decision", "decision_s"),
    ("dispatch", "dispatch_s"), ("execution", "execution_s"), ("outcome", "outcome_s"),
)  # fmt: skip
_UNREADABLE = "Nothing can be shown until that is fixed; o opens another folder."
_NO_RUNS = (
    "{folder} has no evaluation runs yet.",
    "pa-console eval makes some: the paper's ten missions with the default model, scored on the "
    "true state. `pa-console eval --help` names other missions, models and variants.",
    "Runs appear here as they end; o opens another folder.",
)
_GAP = "  "
LEAST_TEXT = 14
"""The minimum width of a text column, in cells; a table may therefore exceed the screen."""

LEAST_WIDTH = 40


def judge_wrong(record: RunRecord) -> bool:
    """Return whether a verdict of the judge, on plan or outcome, contradicts the strict success."""
    given = (record.judge_plan, record.judge_outcome)
    return any(verdict is not None and (verdict == "Success") != record.strict for verdict in given)


_TESTS: dict[Kind, Callable[[RunRecord], bool]] = {
    "all": lambda _: True,
    "strict": lambda record: not record.strict,
    "judge": judge_wrong,
    "rules": lambda record: bool(record.broken),
    "refuse": lambda record: record.expect == "refuse",
}


class RunFilter(NamedTuple):
    """A filter for runs: a kind, and words that must all occur in the facts about a run."""

    kind: Kind = "all"
    text: str = ""

    def passed(self, records: Iterable[RunRecord]) -> list[RunRecord]:
        """Return the records that pass, in the given order."""
        words, fits = self.text.lower().split(), _TESTS[self.kind]
        return [record for record in records if fits(record) and (not words or _has(record, words))]


def _has(record: RunRecord, words: Sequence[str]) -> bool:
    facts = " ".join(
        (record.run, record.mission, record.model, record.variant, record.category, record.world,
         record.status, *record.tags, *(breach.rule_id for breach in record.broken),
         record.command)
    ).lower()  # fmt: skip
    return all(word in facts for word in words)


def run_rows(record: RunRecord) -> list[WrappedRow]:
    """Return the rows of a run, from its command to its latency; faults come before other facts."""
    strict = _score(record.strict)
    expected: list[Part] = [EXPECTED[record.expect]]
    if record.category:
        expected.append((f"  {record.category}", QUIET))
    rows = [
        row("", (f"{record.mission}  ", "bold"), (f"{record.run}  in {record.world}", QUIET)),
        fact("command", record.command),
        fact("expected", *expected),
        fact("strict", strict, "   hybrid ", _score(record.hybrid, "– no verdict"), "   ended ",
               term("mission", record.status).part,
               ("  no asset was moved" if record.refused else "", QUIET)),
    ]  # fmt: skip
    if record.reason:
        rows.append(fact("reason", record.reason))
    rows += [
        fact("broken" if index == 0 else "", (f"✘ {breach.rule_id} ", f"bold {BAD}"),
               breach.what, (f"  {breach.at_s:.1f} s after the command", QUIET))
        for index, breach in enumerate(record.broken)
    ]  # fmt: skip
    rows += [
        fact("not true" if index == 0 else "", ("✘ ", BAD), text)
        for index, text in enumerate(record.failed)
    ]
    rows += [
        fact("plan" if index == 0 else "", text)
        for index, text in enumerate(record.plan or ("none",))
    ]
    rows.append(
        fact("judge", "before ", *_opinion(record.judge_plan, record.strict),
               "   after ", *_opinion(record.judge_outcome, record.strict))
    )  # fmt: skip
    if record.obeyed != record.strict:
        rows.append(fact("", f"if the operator had obeyed the judge: {_word(record)}"))
    if record.verification is not None:
        rows.append(fact("telemetry", term("outcome", record.verification).part))
    rows.append(fact("answers", *_answers(record)))
    rows += _latency(record.metrics)
    return rows


def _score(good: bool | None, none: str = "–") -> tuple[str, str]:
    if good is None:
        return none, QUIET
    return term("score", "success" if good else "failure").part


def _word(record: RunRecord) -> str:
    return "a strict success" if record.obeyed else "a strict failure"


def _opinion(given: Opinion | None, strict: bool) -> list[Part]:
    if given is None:
        return [("– not asked", QUIET)]
    mark = term("verdict", given)
    parts: list[Part] = [mark.part]
    if (given == "Success") != strict:
        parts.append((" ≠ wrong", f"bold {WARN}"))
    return parts


def _answers(record: RunRecord) -> list[Part]:
    parts: list[Part] = [count(record.attempts, "attempt")]
    if not record.valid_json:
        parts.append((", the first answer was not a plan", WARN))
    elif not record.first_sound:
        parts.append((", the first plan broke a Critical or High rule", WARN))
    if record.metrics.plans > 1:
        parts.append(f", {record.metrics.plans} plans carried out")
    if record.reused:
        parts.append((f", {record.reused} reused from identical prompts", QUIET))
    usage = record.planner
    if usage.completion_tokens:
        tokens = f"  first answer {usage.prompt_tokens} + {count(usage.completion_tokens, 'token')}"
        parts.append((f"{tokens}, {duration_text(usage.seconds)}", QUIET))
    return parts


def _latency(metrics: Metrics) -> list[WrappedRow]:
    """Return the duration of every stage that took time; execution is in simulated seconds."""
    taken = [(name, getattr(metrics, field)) for name, field in _STAGES]
    parts: list[Part] = [(duration_text(metrics.end_to_end_s), f"bold {NOTE}"), " in all:"]
    for name, seconds in taken:
        if seconds > 0.0:
            simulated = " simulated" if name == "execution" else ""
            parts += [f"  {name} ", (duration_text(seconds) + simulated, NOTE)]
    return [fact("latency", *parts)]


def title_text(folder: Path, *, tables: bool, width: int) -> Content:
    """Return the title with both views, the shown one marked, and the end of the path."""
    marked = "bold reverse $text-primary"
    head = Content.assemble(
        ("Evaluation  ", "bold $text-primary"),
        (" Runs ", QUIET if tables else marked),
        (" Tables ", marked if tables else QUIET),
        "  ",
    )
    room, where = max(12, width - head.cell_length - 2), homely(folder)
    where = where if len(where) <= room else "…" + where[len(where) - room + 1 :]
    return Content.assemble(head, (where, QUIET))


def totals_text(shown: Sequence[RunRecord], runs: int, problem: str) -> Content:
    """Return the number of shown runs and their success rates, or the problem in reading them."""
    if problem:
        return Content.styled(f"✘ {problem}", BAD)
    of = "" if len(shown) == runs else f" of {runs:,}"
    parts: list[Part] = [(f"{len(shown):,}{of} {'run' if runs == 1 else 'runs'}", "bold")]
    strict = SuccessRate.of(record.strict for record in shown)
    hybrid = SuccessRate.of(record.hybrid for record in shown if record.hybrid is not None)
    for name, rate in (("strict", strict), ("hybrid", hybrid)):
        if rate.value is not None:
            span = f" ({100 * rate.low:.0f}–{100 * rate.high:.0f})"
            parts += [(f"   {name} ", QUIET), (f"{100 * rate.value:.1f} %", NOTE), span]
    if shown:
        parts.append(("   95 % interval", QUIET))
    return Content.assemble(*parts)


def nothing_rows(folder: Path, problem: str) -> tuple[WrappedRow, ...]:
    """Return the reason why there is no run, and the remedy."""
    texts = (_UNREADABLE,) if problem else _NO_RUNS
    return tuple(row("", text.format(folder=homely(folder))) for text in texts)


def homely(path: Path) -> str:
    """Return a path with `~` for the user's home."""
    try:
        return str(Path("~") / path.resolve().relative_to(Path.home()))
    except (ValueError, RuntimeError):
        return str(path)


def tables_text(tables: Sequence[ReportTable], width: int) -> Content:
    """Return all tables, one below another, `width` cells wide unless their numbers need more."""
    lines: list[Content] = []
    for table in tables:
        lines += layout([row("", (table.title, f"bold {NOTE}"))], width)
        lines += _grid(table, width)
        if table.note:
            lines += layout([row("", (table.note, QUIET))], width)
        lines.append(Content())
    return Content("\n").join(lines)


def _grid(table: ReportTable, width: int) -> list[Content]:
    """Return the heading, the rule and the rows; columns of numbers are not cut and align right."""
    numeric = [table.numeric(index) for index in range(len(table.columns))]
    widths = _widths(table, numeric, width)
    heading = [piece.stylize(QUIET) for piece in _line(table.columns, widths, numeric)]
    rule = Content.styled(_GAP.join("─" * room for room in widths), "$faint")
    lines = [*heading, rule]
    for cells in table.rows:
        lines += _line(cells, widths, numeric)
    return lines


def _widths(table: ReportTable, numeric: Sequence[bool], width: int) -> list[int]:
    """Return the width of each column; wide text columns shrink, titles of number columns wrap."""
    columns = list(zip(table.columns, *table.rows, strict=True))
    widths: list[int] = []
    for (title, *cells), right in zip(columns, numeric, strict=True):
        least = [Content(word).cell_length for word in title.split()] if right else []
        whole = [] if right else [Content(title).cell_length]
        widths.append(max([1, *least, *whole, *(Content(cell).cell_length for cell in cells)]))
    room = width - len(_GAP) * (len(widths) - 1)
    texts = [index for index, right in enumerate(numeric) if not right]
    while texts and sum(widths) > room:
        widest = max(texts, key=lambda index: widths[index])
        if widths[widest] <= LEAST_TEXT:
            break
        widths[widest] -= 1
    return widths


def _line(cells: Sequence[str], widths: Sequence[int], numeric: Sequence[bool]) -> list[Content]:
    """Return one row of cells, with as many lines as its tallest cell."""
    wrapped = [Content(text).wrap(room) for text, room in zip(cells, widths, strict=True)]
    lines: list[Content] = []
    for number in range(max(map(len, wrapped), default=0)):
        parts: list[Content] = []
        for pieces, room, right in zip(wrapped, widths, numeric, strict=True):
            piece = pieces[number] if number < len(pieces) else Content()
            gap = Content(" " * max(0, room - piece.cell_length))
            parts.append(gap + piece if right else piece + gap)
        lines.append(Content(_GAP).join(parts).rstrip())
    return lines


class ReportTables(ScrollableContainer):
    """A pane of tables, or of a text in their place; it scrolls both ways."""

    _tables: Sequence[ReportTable] = ()

    def compose(self) -> ComposeResult:
        """Yield the widget for the text."""
        yield Static(id="evaluation-text", markup=False)

    def show(self, tables: Sequence[ReportTable], instead: Content) -> None:
        """Show `tables`, or `instead` if there are none."""
        self._tables = tables
        if tables:
            self._write()
        else:
            self.query_one(Static).update(instead)

    def on_resize(self, _event: events.Resize) -> None:
        """Lay the tables out for the current width."""
        if self._tables:
            self._write()

    def _write(self) -> None:
        width = self.scrollable_content_region.width
        if width:
            self.query_one(Static).update(tables_text(self._tables, max(LEAST_WIDTH, width - 2)))


def _verdict(given: Opinion | None, strict: bool) -> tuple[str, str]:
    if given is None:
        return "–", QUIET
    mark = term("verdict", given)
    wrong = (given == "Success") != strict
    return f"{mark.glyph} {mark.word}{'≠' * wrong}", WARN if wrong else mark.style


class RunRows(PointedRows[RunRecord]):
    """The list of runs; a verdict that contradicts the true state is marked with ≠."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "choose", "Trace")]
    COLUMNS: ClassVar[Layout] = Layout(
        "mission",
        (("mission", 8), ("model", 18), ("variant", 15), ("seed", 4), ("strict", 9), ("hybrid", 9),
         ("judge plan", 10), ("judge end", 10), ("status", 14), ("time", 8)),
        ("seed", "variant", "judge plan", "judge end", "time", "hybrid"),
    )  # fmt: skip

    def grown(self, room: int) -> Mapping[str, int]:
        """Give the mission a part of the remaining room."""
        return {"mission": min(room, 20)}

    def cells(self, key: str) -> Cells:
        """Return the cells of a run."""
        record = self.items[key]
        return {
            "mission": (record.mission, "bold"),
            "model": (record.model, ""),
            "variant": (record.variant, QUIET if record.variant == "full" else ""),
            "seed": (f"{record.seed:>4}", QUIET),
            "strict": _score(record.strict),
            "hybrid": _score(record.hybrid),
            "judge plan": _verdict(record.judge_plan, record.strict),
            "judge end": _verdict(record.judge_outcome, record.strict),
            "status": term("mission", record.status).part,
            "time": (f"{record.metrics.end_to_end_s:6.1f} s", QUIET),
        }
