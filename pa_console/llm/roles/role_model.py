"""A model in the roles of planner and judge, and how it is spoken to."""

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from pa_console.llm.backend import CANCELLED, Backend
from pa_console.llm.roles.dialect import DIALECTS, Dialect
from pa_console.llm.roles.judge import Judge
from pa_console.llm.roles.planner import Planner


@dataclass(frozen=True)
class RoleModel:
    """Planner and judge of one model in its `dialect`; `server` is None for the session's own."""

    planner: Planner
    judge: Judge
    dialect: Dialect
    server: Backend | None = None

    @classmethod
    def on(cls, server: Backend) -> "RoleModel":
        """Return the roles of a model on a server, which needs instructions and examples."""
        dialect = DIALECTS["examples"]
        return cls(
            Planner(server, max_tokens=dialect.plan_tokens),
            Judge(server, max_tokens=dialect.verdict_tokens),
            dialect,
            server,
        )

    @property
    def where(self) -> str:
        """The model on a server, '' for the session's own."""
        return self.server.name if self.server is not None else ""


class Answer(Protocol):
    """The answer of a role, with the reason why it cannot be used, '' if it can."""

    @property
    def error(self) -> str:
        """The reason why the answer cannot be used."""
        ...


AnswerT = TypeVar("AnswerT", bound=Answer)


async def first_answer(
    models: Sequence[RoleModel],
    ask: Callable[[RoleModel], Awaitable[AnswerT]],
    failed: Callable[[RoleModel, str], None],
) -> AnswerT:
    """Return the answer of the first of `models` that gives one; the last one's is taken as it is.

    `failed` is told which gave none, and why. Who is interrupted asks nobody else.
    """
    *before, last = models
    for model in before:
        answer = await ask(model)
        if answer.error in {"", CANCELLED}:
            return answer
        failed(model, answer.error)
    return await ask(last)
