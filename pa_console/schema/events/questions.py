"""Events of questions: what the operator asked the console, and what it answered."""

from typing import Literal

from pydantic import Field

from pa_console.schema.base import Name, StrictModel
from pa_console.schema.events.base import Payload

QuestionTopic = Literal[
    "plan",  # why this plan, or why none
    "asset",  # why this asset
    "other_asset",  # why not that one
    "gate",  # why a gate has no guard
    "alternatives",  # what else would serve the order
]
"""The subject of a question."""


class AnswerLine(StrictModel):
    """One statement of an answer: what it is `about`, in a word or two, and what is `said`."""

    about: str
    said: str


class QuestionAnswered(Payload):
    """A question about the record, with its answer; no model was asked.

    The event's mission is the subject of the question. No decision follows, and no asset moves by
    it.
    """

    kind: Literal["question_answered"] = "question_answered"
    question: str = Field(description="the words of the operator")
    topic: QuestionTopic = "plan"
    subjects: tuple[Name, ...] = Field(default=(), description="the assets or the gate asked about")
    lines: tuple[AnswerLine, ...] = ()
