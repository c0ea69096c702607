"""The whole trace of a mission as a Markdown document, in the order of the mission's steps."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from itertools import groupby
from urllib.parse import quote

from pa_console.schema.events.event import SessionStarted
from pa_console.schema.rule import Rule
from pa_console.schema.text import visible, visible_line
from pa_console.session.mission_trace import MissionTrace
from pa_console.views.trace_layout import lay_out, progress
from pa_console.views.trace_parts import (
    Block,
    Detail,
    Spans,
    Text,
    TraceLine,
    TraceOptions,
    TraceSection,
    TraceTable,
)

_OPTIONS = TraceOptions(Detail.RECORD, evidence=True)
_DEEPEST = 6
"""The deepest level of headings in Markdown."""

_SPECIAL = re.compile(r"[\\`*\[\]<>#|~&$]|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])")
_LIST_MARK = re.compile(r"^(\s*)(?:([-+=:])|(\d+)([.)])(?=\s|$))")
_LINK = re.compile(r"(?i)\b(https?|ftp)://|\bwww\.|(?<=[\w/])\.(?=[^\W\d])")
_BREAKS = re.compile(r"\r\n|[\r\n\v\f\x1c-\x1e\x85\u2028\u2029]")


def inline(text: str) -> str:
    """Return `text` for one line of Markdown; line breaks in it become `<br>`."""
    return "<br>".join(_line(line) for line in _BREAKS.split(text.strip()))


def _line(text: str) -> str:
    """Return one line, escaped so that it contains no markup of Markdown or HTML."""
    text = visible(text.strip())
    linked = _LINK.sub(lambda match: match[0].replace(":", "\0").replace(".", "\1"), text)
    marked = _SPECIAL.sub(r"\\\g<0>", linked).replace("\0", r"\:").replace("\1", r"\.")
    return _LIST_MARK.sub(_escaped_mark, marked)


def _escaped_mark(match: re.Match[str]) -> str:
    return f"{match[1]}\\{match[2]}" if match[2] else f"{match[1]}{match[3]}\\{match[4]}"


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table of plain values, escaped; None and empty values become a dash."""
    lines = [heads, ["---"] * len(heads)]
    lines += [[inline(str(cell)) if cell not in (None, "") else "–" for cell in r] for r in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def fenced(text: str, language: str = "text") -> str:
    """Return `text` as a code block whose fence is longer than any run of backticks in it."""
    runs = [len(run) for run in re.findall(r"`+", text)]
    fence = "`" * max([3, *(length + 1 for length in runs)])
    body = "\n".join(visible(line) for line in _BREAKS.split(text))
    return f"{fence}{language}\n{body}\n{fence}"


def folded(summary: str, body: str) -> str:
    """Return `body` as a folded part with the plain text `summary` as its heading."""
    return f"<details>\n<summary>{escape(visible_line(summary))}</summary>\n\n{body}\n\n</details>"


def mission_document(
    trace: MissionTrace,
    started: SessionStarted,
    rules: Mapping[str, Rule],
    notes: tuple[str, ...] = (),
    stills: str = "",
) -> str:
    """Return the document of a mission; `notes` are remarks on the log or the rules.

    `stills` is the path from the document to the folder with the camera stills; '' shows none.
    """
    parts = [
        f"# Mission {inline(trace.mission.id)}",
        f"> {inline(trace.mission.said)}",
        *([f"Read as: {inline(trace.mission.text)}"] if trace.mission.typed else []),
        *(f"**Note:** {inline(note)}" for note in notes),
        _standing(trace),
        _pinned(trace, started),
    ]
    for section in lay_out(trace, rules, _OPTIONS):
        parts += section_parts(section)
    parts += _stills(trace, stills)
    return "\n\n".join(parts) + "\n"


def _stills(trace: MissionTrace, folder: str) -> Iterator[str]:
    """Yield, for each plan, the camera still that was last shown with it."""
    if trace.stills:
        yield "## Stills"
    for number, still in trace.stills.items():
        caption = f"{still.track} by {still.camera}, at {still.taken_s:.1f} s, with plan {number}"
        if still.sha256 is None:
            yield f"{inline(caption)}: {inline(still.problem)}"
            continue
        if folder:
            yield f"![{inline(caption)}](<{quote(folder)}/{still.file_name}>)"
        yield f"{inline(caption)}, SHA-256 {still.sha256}"


def _standing(trace: MissionTrace) -> str:
    """Return a line that states how the mission ended, or that it is not finished."""
    mark, *rest = (span.text for span in progress(trace))
    if trace.status is None:
        return f"**Not finished:** {inline(mark)}"
    return f"**{inline(mark)}**: {inline(''.join(rest)) or 'no reason given'}"


def section_parts(section: TraceSection, level: int = 2) -> Iterator[str]:
    """Yield a section's paragraphs, lists and tables; a collapsed section is folded.

    An attempt or a plan is never folded as a whole, but its sections may be.
    """
    content = list(_blocks(section.blocks))
    if section.collapsed and not section.parts:
        mark = section.mark.text if section.mark is not None else ""
        summary = " · ".join(words for words in (section.title, mark, section.note) if words)
        yield folded(summary, "\n\n".join(content))
        return
    yield f"{'#' * min(level, _DEEPEST)} {inline(section.title)}"
    if about := _about(section):
        yield about
    yield from content
    for part in section.parts:
        yield from section_parts(part, level + 1)


def _about(section: TraceSection) -> str:
    """Return the step, the status and the note of a section in one line."""
    facts = [f"*Step {section.step}*"] if section.step else []
    facts += [f"**{inline(section.mark.text)}**"] if section.mark is not None else []
    facts += [inline(section.note)] if section.note else []
    return " · ".join(facts)


def _blocks(blocks: Iterable[Block]) -> Iterator[str]:
    """Yield each block; adjacent lines with a label or a mark become a list."""
    for listed, group in groupby(blocks, _is_listed):
        if listed:
            yield "\n".join(_item(line) for line in group if isinstance(line, TraceLine))
        else:
            yield from filter(None, map(_block, group))


def _block(block: Block) -> str:
    match block:
        case TraceLine(body=body):
            return _joined(body)
        case TraceTable():
            return _table(block) if block.rows else ""
        case Text(text=text, caption=caption, verbatim=verbatim):
            head = f"{inline(caption.capitalize())}:\n\n" if caption and text else ""
            return head + (fenced(text) if verbatim and text else inline(text))


def _is_listed(block: Block) -> bool:
    return isinstance(block, TraceLine) and bool(block.label or block.mark or block.depth)


def _item(line: TraceLine) -> str:
    label = f"**{inline(line.label)}:**" if line.label else ""
    mark = f"**{inline(line.mark.text)}**" if line.mark is not None else ""
    words = " ".join(part for part in (label, mark, _joined(line.body)) if part)
    return f"{'  ' * line.depth}- {words}"


def _joined(spans: Spans) -> str:
    return inline("".join(span.text for span in spans))


def _table(given: TraceTable) -> str:
    """Return a table of those columns that have a head and at least one value."""
    shown = [
        place
        for place, column in enumerate(given.columns)
        if column.head and any(row[place].text for row in given.rows)
    ]
    heads = [given.columns[place].head for place in shown]
    return table(heads, [[row[place].text for place in shown] for row in given.rows])


def _pinned(trace: MissionTrace, started: SessionStarted) -> str:
    """Return a table of the mission's origin and of the pinned inputs for running it again."""
    mission = trace.mission
    rows = [
        ("given", f"{mission.created:%Y-%m-%d %H:%M:%S} UTC by {mission.source}"),
        ("agent", mission.agent and f"{mission.agent}, over MCP"),
        ("alarm", mission.alarm),
        ("standing order", mission.standing),
        ("about", mission.subject),
        ("gate", mission.gate),
        ("session", started.session),
        ("world", f"{started.world} {started.world_sha256[:12]}"),
        ("rules", f"{started.rules} {started.rules_sha256[:12]}"),
        ("scenario", started.scenario),
        ("model", f"{started.model} {started.model_sha256[:12]}"),
        ("sampler", started.sampler),
        ("seed", started.seed),
        ("version", started.version),
    ]
    return table(("what", "value"), [row for row in rows if row[1] not in (None, "")])
