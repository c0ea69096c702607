"""What the operator has asked about a mission, and what the console answered."""

from collections.abc import Iterator, Sequence

from pa_console.schema.events.questions import AnswerLine, QuestionAnswered
from pa_console.session.trace.parts import Line, Section, Span

_MOST_LABEL = 15
"""Cells that what a line is about may take where such lines stand one below the other."""


def answered(given: Sequence[QuestionAnswered]) -> list[Section]:
    """Return a section for each question, the last one open and those before it folded."""
    return [
        Section(
            f"asked-{number}",
            f"You asked: {told.question}",
            tuple(_lines(told.lines)),
            collapsed=number < len(given),
            tone="note",
        )
        for number, told in enumerate(given, start=1)
    ]


def _lines(given: Sequence[AnswerLine]) -> Iterator[Line]:
    """Yield an answer with what each line is about before it, said once where it is the same."""
    width = min(max((len(line.about) for line in given), default=0), _MOST_LABEL)
    before = ""
    for line in given:
        label = " " if line.about == before else line.about
        before = line.about
        yield Line((Span(line.said),), label, "quiet", width=width)
