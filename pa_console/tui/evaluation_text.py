"""The lines above an evaluation's runs, and what is said when there are none."""

from pathlib import Path

from textual.content import Content

from pa_console.tui.run_filter import Totals
from pa_console.tui.trace.rows import Part, Row, row
from pa_console.tui.vocabulary import BAD, NOTE, QUIET

_UNREADABLE = "Nothing can be shown until that is mended; o opens another folder."
_NO_RUNS = (
    "{folder} holds no run of an evaluation yet.",
    "pa-console eval makes some: the paper's ten missions with the default model, scored on the "
    "true state. `pa-console eval --help` names other missions, models and variants.",
    "Runs appear here as they end; o opens another folder.",
)


def title_text(folder: Path, *, tables: bool, width: int) -> Content:
    """Return the title with the two views, the shown one marked, and the end of the path."""
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


def totals_text(totals: Totals, problem: str) -> Content:
    """Return how many runs are shown with their rates, or why the runs cannot be read."""
    if problem:
        return Content.styled(f"✘ {problem}", BAD)
    of = "" if totals.shown == totals.runs else f" of {totals.runs:,}"
    word = "run" if totals.runs == 1 else "runs"
    parts: list[Part] = [(f"{totals.shown:,}{of} {word}", "bold")]
    for name, rate in (("strict", totals.strict), ("hybrid", totals.hybrid)):
        if rate.value is not None:
            span = f" ({100 * rate.low:.0f}–{100 * rate.high:.0f})"
            parts += [(f"   {name} ", QUIET), (f"{100 * rate.value:.1f} %", NOTE), span]
    if totals.shown:
        parts.append(("   95 % interval", QUIET))
    return Content.assemble(*parts)


def nothing_rows(folder: Path, problem: str) -> tuple[Row, ...]:
    """Say why there is no run and what to do."""
    texts = (_UNREADABLE,) if problem else _NO_RUNS
    return tuple(row("", text.format(folder=homely(folder))) for text in texts)


def homely(path: Path) -> str:
    """Write a path with `~` for the user's home."""
    try:
        return str(Path("~") / path.resolve().relative_to(Path.home()))
    except (ValueError, RuntimeError):
        return str(path)
