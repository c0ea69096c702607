"""Labelled queries: which rules concern a text, so that retrieval can be measured."""

from typing import Literal, Self

from pydantic import Field, model_validator

from pa_console.schema.base import Name, StrictModel
from pa_console.schema.mission import MAX_MISSION_TEXT

Grade = Literal[1, 2]
"""2: the rule governs what the text asks for; 1: it bears on it."""

Split = Literal["dev", "test", "field"]
"""For choosing a method; for reporting; by other people than those who wrote and chose."""


class RetrievalQuery(StrictModel):
    """A mission text or question, and the rules that concern it; rules not named do not."""

    id: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    split: Split
    style: str = Field(min_length=1, description="how it is said: terse, chatty, misspelt, ...")
    text: str = Field(min_length=1, max_length=MAX_MISSION_TEXT)
    relevant: dict[str, Grade] = Field(description="rule id -> grade")

    @property
    def governing(self) -> frozenset[str]:
        """The rules that govern what the text asks for: those that retrieval must not miss."""
        return frozenset(rule for rule, grade in self.relevant.items() if grade == 2)

    @model_validator(mode="after")
    def _governed(self) -> Self:
        if not self.governing:
            raise ValueError("relevant: at least one rule must have grade 2")
        return self


class QuerySet(StrictModel):
    """A file of labelled queries for one rule file."""

    name: Name
    queries: tuple[RetrievalQuery, ...] = Field(min_length=1)
