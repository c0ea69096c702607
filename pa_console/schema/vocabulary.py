"""Which words of operators and of policies concern the same thing; data for retrieval only."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from pa_console.schema.base import Name, StrictModel

Word = Annotated[str, Field(pattern=r"^[^\W_]+$", max_length=40)]


class Vocabulary(StrictModel):
    """Groups of words that concern the same thing, and words that concern nothing.

    A word may stand in several groups, but not both in a group and among the ignored ones.
    """

    name: Name = "none"
    groups: dict[Name, tuple[Word, ...]] = {}
    ignored: tuple[Word, ...] = Field(default=(), description="words that are not looked for")

    @model_validator(mode="after")
    def _ignored_words_have_no_group(self) -> Self:
        ignored = set(self.ignored)
        for group, words in self.groups.items():
            for index, word in enumerate(words):
                if word in ignored:
                    raise ValueError(
                        f"groups.{group}.{index}: {word!r} is also ignored; take it out of one"
                    )
        return self
