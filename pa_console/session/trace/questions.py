"""What the operator has asked about a mission, and what the console answered."""

from collections.abc import Sequence

from pa_console.schema.events.questions import QuestionAnswered
from pa_console.session.trace.parts import Line, Section, labelled


def answered(given: Sequence[QuestionAnswered]) -> list[Section]:
    """Return a section for each question, the last one open and those before it folded."""
    return [
        Section(
            f"asked-{number}",
            f"You asked: {told.question}",
            answer_lines(told),
            collapsed=number < len(given),
            tone="note",
        )
        for number, told in enumerate(given, start=1)
    ]


def answer_lines(told: QuestionAnswered) -> tuple[Line, ...]:
    """Return an answer line by line, each with what it is about."""
    return tuple(labelled(line.about, line.said) for line in told.lines)
