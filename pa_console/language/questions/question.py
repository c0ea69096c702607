"""A question about what is on record: what it is about, and who or which gate is meant."""

from dataclasses import dataclass

from pa_console.schema.events.questions import QuestionTopic


@dataclass(frozen=True)
class Question:
    """A question in the operator's words.

    `subjects` are the assets that it may mean, or the gate; none where it is about the whole plan.
    """

    text: str
    topic: QuestionTopic
    subjects: tuple[str, ...] = ()
