"""Plans side by side: the waiting plan, plans for other readings, and more for the same one."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, VerticalScroll
from textual.content import Content
from textual.screen import Screen
from textual.widgets import Static

from pa_console.language.canonical.reading import asked_words, plain_reading
from pa_console.schema.mission import Decision
from pa_console.schema.rehearsal import RehearsedReading
from pa_console.schema.text import count
from pa_console.schema.world import World
from pa_console.session.mission_trace import Attempt, MissionTrace
from pa_console.station.answers.alternatives import order_for
from pa_console.tui.actions import ALT_DIGITS, READING_KEYS
from pa_console.tui.approval.plan_words import action_rows, cover_row
from pa_console.tui.plan_preview import PlanPreview
from pa_console.tui.rows import WrappedRow, fact, row
from pa_console.tui.status_words import BAD, GOOD, QUIET, WARN
from pa_console.tui.widgets.bars import KeyFooter
from pa_console.tui.widgets.row_views import TextRows

MOST_BESIDE = 2
"""The number of plans shown beside the waiting one, unless there are more readings."""

OTHER_WAY = "another plan for the same reading, chosen instead of the proposed one"
_LEAD = 10

LIST_CELLS = 100
"""The width in cells below which the plans are stacked."""


@dataclass(frozen=True)
class ComparedPlan:
    """A rehearsed plan in a comparison.

    `decision` is the decision that chooses the plan; it is None for the waiting plan. If no plan
    waits, `order` is the order to type for this plan, or '' for the mission's last plan. `judge` is
    the judge's opinion in words, and `sure` the confidence in the reading, if they are known.
    """

    title: str
    reading: str
    preview: PlanPreview
    broken: tuple[str, ...] = ()
    decision: Decision | None = None
    judge: str = ""
    sure: float | None = None
    order: str = ""


def past_candidate(trace: MissionTrace, attempt: Attempt, world: World) -> ComparedPlan | None:
    """Return the plan of a mission's last attempt; None if it was not rehearsed."""
    if attempt.plan is None or attempt.rehearsal is None:
        return None
    return ComparedPlan(
        f"The plan of {trace.mission.id}",
        plain_reading(asked_words(attempt.plan.reason).rstrip("; ")),
        PlanPreview(world, attempt.plan, attempt.rehearsal),
        tuple(finding.rule_id for finding in attempt.findings if finding.broken),
        judge=_judged(attempt),
        sure=attempt.sure,
    )


def waiting_candidate(trace: MissionTrace, preview: PlanPreview) -> ComparedPlan:
    """Return the plan that waits for a decision, for comparison with others."""
    request = trace.approval
    attempt = trace.find(request.attempt) if request is not None else None
    broken = (*request.blocked_by, *request.acknowledge) if request is not None else ()
    return ComparedPlan(
        "The plan that waits",
        plain_reading(canonical_reading(trace)),
        preview,
        broken,
        judge=_judged(attempt) if attempt is not None else "",
        sure=attempt.sure if attempt is not None else None,
    )


def _judged(attempt: Attempt) -> str:
    if attempt.verdict is None:
        return ""
    return "objects" if attempt.verdict.verdict == "Failure" else "does not object"


def canonical_reading(trace: MissionTrace) -> str:
    """Return the reading of the waiting plan in canonical words; '' if no plan waits."""
    request = trace.approval
    if request is None:
        return ""
    return request.asked or asked_words(request.plan.reason).rstrip("; ")


def other_reading(
    number: int, asked: str, rehearsed: RehearsedReading, world: World, request_id: str
) -> ComparedPlan:
    """Return the plan for another reading of the order."""
    words = plain_reading(asked)
    return ComparedPlan(
        f"(Alt+{number}) another reading",
        words,
        PlanPreview(world, rehearsed.plan, rehearsed.rehearsal, words),
        rehearsed.faults,
        Decision(kind="choose", request_id=request_id, asked=asked),
    )


def other_way(
    number: int, asked: str, rehearsed: RehearsedReading, world: World, request_id: str | None
) -> ComparedPlan:
    """Return another plan for the same reading; if no request waits, it has an order to type."""
    decision = None
    if request_id is not None:
        decision = Decision(
            kind="modify", request_id=request_id, plan=rehearsed.plan, reason=OTHER_WAY
        )
    return ComparedPlan(
        f"(Alt+{number}) another way",
        plain_reading(asked),
        PlanPreview(world, rehearsed.plan, rehearsed.rehearsal),
        rehearsed.faults,
        decision,
        order="" if decision is not None else order_for(rehearsed.plan, world.base),
    )


def candidate_rows(candidate: ComparedPlan) -> Iterator[WrappedRow]:
    """Yield the facts to compare, always in the same order."""
    preview = candidate.preview
    yield fact("read as", candidate.reading or ("unknown", QUIET), width=_LEAD)
    yield from action_rows(preview)
    yield cover_row(preview) or row(("Guards  ", QUIET), "unchanged at every gate")
    yield fact("time", f"{preview.duration_s:.0f} s", width=_LEAD)
    yield fact("battery", _battery(preview), width=_LEAD)
    if candidate.broken:
        yield fact("rules", ("; ".join(candidate.broken), BAD), width=_LEAD)
    else:
        yield fact("rules", ("none broken", GOOD), width=_LEAD)
    chosen = candidate.decision is not None or bool(candidate.order)
    judge = candidate.judge or ("asked once you choose it" if chosen else "not asked")
    style = WARN if judge == "objects" else QUIET if chosen else ""
    yield fact("judge", (judge, style), width=_LEAD)
    sure = f"{candidate.sure:.0%}" if candidate.sure is not None else ""
    unknown = "known once you choose it" if chosen else "unknown"
    yield fact("confidence", sure or unknown, width=_LEAD)


def _battery(preview: PlanPreview) -> str:
    lines = preview.rehearsal.timeline.assets
    if not lines:
        return "no asset moves"
    name = min(lines, key=lambda each: lines[each].least_battery_pct)
    return f"at least {lines[name].least_battery_pct:.0f} % ({name})"


class CandidateColumn(VerticalScroll, can_focus=True):
    """The column of one plan; each column scrolls separately."""

    def __init__(self, candidate: ComparedPlan) -> None:
        super().__init__(classes="candidate")
        self.candidate = candidate
        self.border_title = candidate.title

    def compose(self) -> ComposeResult:
        """Yield the rows of the facts to compare."""
        yield TextRows()

    def on_mount(self) -> None:
        """Fill in the rows."""
        self.query_one(TextRows).show(tuple(candidate_rows(self.candidate)))


class PlanComparison(Screen[ComparedPlan | None]):
    """Plans in columns, or in a list on narrow terminals; Enter chooses the plan at the pointer.

    The screen approves nothing: the chosen plan is checked, judged and proposed to the operator
    like any other plan. The result is the chosen plan, or None.
    """

    BINDINGS = [
        Binding("escape", "dismiss", "Back"),
        Binding("enter", "choose", "Choose"),
        Binding("left,up", "point(-1)", "Before", show=False),
        Binding("right,down", "point(1)", "Next", show=False),
        *(
            Binding(f"{key},{alias}", f"point_at({n})", "Select this plan", show=False)
            for n, (key, alias) in enumerate(zip(READING_KEYS, ALT_DIGITS, strict=True), start=1)
        ),
    ]

    def __init__(
        self,
        first: ComparedPlan,
        begin: "Callable[[PlanComparison], object]",
        ended: Callable[[], object],
    ) -> None:
        """Show `first`, the waiting plan or the last plan of a mission.

        `begin` is called when other plans can be added, and `ended` when the screen is left.
        """
        super().__init__()
        self._first, self._begin, self._ended = first, begin, ended

    def compose(self) -> ComposeResult:
        """Yield the title, the columns, the state of the search and the footer."""
        yield Static(id="comparison-title", markup=False)
        with Horizontal(id="comparison-plans"):
            yield CandidateColumn(self._first)
        yield Static(id="comparison-note", markup=False)
        yield KeyFooter()

    @property
    def columns(self) -> list[CandidateColumn]:
        """The columns of the plans; the first plan's column comes first."""
        return list(self.query(CandidateColumn).results(CandidateColumn))

    def on_mount(self) -> None:
        """Point at the first plan, and begin the search for other plans."""
        self.columns[0].focus()
        self.tell("looking for other plans; Esc stops the search")
        self._begin(self)

    def on_unmount(self) -> None:
        """End the search for other plans."""
        self._ended()

    def on_resize(self, event: events.Resize) -> None:
        """Show the plans side by side if there is room."""
        self.set_class(event.size.width < LIST_CELLS, "-list")

    def add(self, candidate: ComparedPlan) -> None:
        """Show one more plan; the pointer does not move."""
        self.query_one("#comparison-plans", Horizontal).mount(CandidateColumn(candidate))

    def tell(self, text: str) -> None:
        """Show the state of the search, and the number of plans."""
        self.query_one("#comparison-note", Static).update(Content(f" {text}"))
        title = f" PLANS SIDE BY SIDE  {count(len(self.columns), 'plan')}"
        self.query_one("#comparison-title", Static).update(Content(title))

    def action_point(self, by: int) -> None:
        """Point at the previous or the next plan."""
        columns = self.columns
        self.action_point_at((self._pointed(columns) + by) % len(columns))

    def action_point_at(self, number: int) -> None:
        """Point at the plan with this number, 0 for the first; do nothing if there is none."""
        for column in self.columns[number : number + 1]:
            column.focus()

    def _pointed(self, columns: Iterable[CandidateColumn]) -> int:
        return next((n for n, column in enumerate(columns) if column.has_focus), 0)

    def action_choose(self) -> None:
        """Return the plan at the pointer as the result; the waiting plan is not changed."""
        columns = self.columns
        self.dismiss(columns[self._pointed(columns)].candidate)
