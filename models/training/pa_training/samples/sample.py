"""Training samples: a prompt, the answer that is wanted, and where the sample came from."""

from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from pa_console.llm.roles.prompts import Prompt
from pa_console.schema.base import StrictModel
from pa_console.schema.events.event import Role


class Sample(StrictModel):
    """One prompt with its answer; samples of a `group` share `system` and `picture`."""

    group: str
    system: str
    picture: str = Field(description="the beginning of the user's turn that the group shares")
    rest: str = Field(description="the end of the user's turn: rules, mission, what is judged")
    answer: str = Field(description="what the model is to write, without an end mark")
    task: Role
    kind: str = Field(description="what it is a sample of, for tables: e.g. go/plain")
    given: str = Field(
        default="", description="the part of the answer that the grammar writes: nothing to learn"
    )
    goes_on: bool = Field(
        default=False, description="more would follow the answer, and is nothing to learn"
    )


def make_sample(  # noqa: PLR0917
    group: str,
    task: Role,
    prompt: Prompt,
    picture: str,
    answer: str,
    kind: str,
    given: str = "",
) -> Sample:
    """Split `prompt` after `picture`; raises ValueError when it does not begin with it."""
    if not prompt.user.startswith(picture):
        raise ValueError(f"{group}: the prompt does not begin with the group's picture")
    return Sample(
        group=group,
        system=prompt.system,
        picture=picture,
        rest=prompt.user[len(picture) :],
        answer=answer,
        task=task,
        kind=kind,
        given=given,
    )


def read_samples(path: Path, task: Literal["planner", "judge", ""] = "") -> Iterator[Sample]:
    """Yield the samples of `path`, of one adapter's tasks if asked.

    Raises OSError, and ValueError with file and line for what is no sample.
    """
    wanted = {"planner": {"planner"}, "judge": {"judge", "outcome"}}.get(task)
    with path.open(encoding="utf-8") as stream:
        for number, line in enumerate(stream, 1):
            try:
                sample = Sample.model_validate_json(line)
            except ValidationError as error:
                first = error.errors(include_url=False)[0]
                where = ".".join(map(str, first["loc"]))
                raise ValueError(f"{path}:{number}: {where}: {first['msg']}") from error
            if wanted is None or sample.task in wanted:
                yield sample
