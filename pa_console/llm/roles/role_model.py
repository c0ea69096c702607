"""A model in the roles of planner and judge, and the format of its prompts.

A model without adapters needs instructions and examples in every prompt. It writes either only a
reading of an order (`clauses`) or the plan itself (`examples`). A model with adapters was trained
on short prompts and short verdicts (`compact_prompts.py`).
"""

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol, TypeVar

from pa_console.language.clause_grammar import ASKED_ONCE, grounded_asked, grounded_reason
from pa_console.llm.backend import CANCELLED, Backend
from pa_console.llm.roles.clause_reader import MAX_TOKENS, reading_prefix, reading_prompt
from pa_console.llm.roles.compact_prompts import (
    compact_fixed,
    compact_judge_prompt,
    compact_outcome_prompt,
    compact_planner_prompt,
    picture_prefix,
    typed_prefix,
)
from pa_console.llm.roles.grammar import (
    compact_judge_grammar,
    compact_opening_grammar,
    judge_grammar,
)
from pa_console.llm.roles.judge import Judge
from pa_console.llm.roles.planner import Planner
from pa_console.llm.roles.prompts import (
    Prompt,
    fixed_part,
    judge_prompt,
    outcome_prompt,
    planner_prompt,
)
from pa_console.schema.evaluation import Variant
from pa_console.schema.events.event import Role
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import World

PromptFormatName = Literal["examples", "clauses", "compact"]


@dataclass(frozen=True)
class PromptFormat:
    """The prompts of every role, the grammar of a verdict, and the parts that can be read ahead."""

    name: PromptFormatName
    planner: Callable[..., Prompt]
    judge: Callable[..., Prompt]
    outcome: Callable[..., Prompt]
    verdict: Callable[..., str]
    reason: Callable[[World, Digest, str, str], Sequence[str]]
    """A function that returns the possible reasons of a plan, as regular expressions that must all
    match. If there are none, any reason is possible. The third argument has the mission's words,
    and the last argument is the operator's reading, or '' if there is none."""
    opening: Callable[[World, Digest, str, str], str] | None
    """A function that returns the grammar of the beginning of a verdict on a plan, which is the
    judge's reading. The console compares this reading with the plan. If the function is None, the
    judge itself compares them. The arguments are those of `reason`."""
    outcome_opening: str | None
    """The grammar of the beginning of a verdict on an outcome, if there is no verdict on the plan.
    """
    ahead: Callable[[Role, World, Digest | None], Prompt]
    """A function that returns the beginning of a role's prompts that does not depend on a mission.
    The digest is None if the world is too large for the prompt."""
    typed: Callable[[Role, World, Digest, Sequence[Rule], str], Prompt] | None
    """A function that returns the beginning of a prompt with the rules and the words of a mission
    that is being typed. It is None if the picture is not at the beginning of a prompt, because
    reading ahead then saves no time."""
    plan_tokens: int
    verdict_tokens: int
    """The token limits of the answers; the context has room for them."""
    served: bool = False
    """True if the planner writes only a reading, from which the console makes the plan."""


def _fixed_only(role: Role, world: World, _digest: Digest | None) -> Prompt:
    """Return the fixed part only, because here the picture comes after the retrieved rules."""
    return Prompt(fixed_part(role, world), "")


def _compact_ahead(role: Role, world: World, digest: Digest | None) -> Prompt:
    """Return the fixed part and the picture, but no picture for an outcome: it is a later one."""
    if digest is None or role == "outcome":
        return Prompt(compact_fixed(role, world), "")
    return picture_prefix(role, world, digest)


def _compact_opening(world: World, digest: Digest, words: str, reading: str) -> str:
    return compact_opening_grammar(grounded_asked(world, digest, words, reading))


def _reader_ahead(role: Role, world: World, digest: Digest | None) -> Prompt:
    """Return clauses and picture for a planner; for a judge, the same as in `examples`."""
    if role == "planner":
        return reading_prefix(world, digest)
    return _fixed_only(role, world, digest)


_EXAMPLES = PromptFormat(
    "examples",
    planner_prompt,
    judge_prompt,
    outcome_prompt,
    judge_grammar,
    lambda _world, _digest, _words, _asked: (),
    None,
    None,
    _fixed_only,
    None,
    700,
    900,
)

PROMPT_FORMATS: dict[PromptFormatName, PromptFormat] = {
    "examples": _EXAMPLES,
    "clauses": replace(
        _EXAMPLES,
        name="clauses",
        planner=reading_prompt,
        reason=grounded_asked,
        ahead=_reader_ahead,
        plan_tokens=MAX_TOKENS,
        served=True,
    ),
    "compact": PromptFormat(
        "compact",
        compact_planner_prompt,
        compact_judge_prompt,
        compact_outcome_prompt,
        compact_judge_grammar,
        grounded_reason,
        _compact_opening,
        compact_opening_grammar((ASKED_ONCE,)),
        _compact_ahead,
        typed_prefix,
        400,
        200,
    ),
}
"""The prompt formats by the names that are used in the catalogue."""


def format_in(variant: Variant, prompts: PromptFormatName) -> PromptFormatName:
    """Return the prompt format of a model with `prompts` in an evaluation's `variant`.

    A trained model keeps its own format. The paper's prompt requests a plan, so it needs
    `examples`.
    """
    if prompts == "compact":
        return prompts
    return "examples" if variant.prompt == "paper" else variant.dialect or prompts


@dataclass(frozen=True)
class RoleModel:
    """The planner and the judge with one model; `server` is None for the session's local model."""

    planner: Planner
    judge: Judge
    prompt_format: PromptFormat
    server: Backend | None = None

    @classmethod
    def on(cls, server: Backend) -> "RoleModel":
        """Return the roles of a model on a server, which needs instructions and examples."""
        prompt_format = PROMPT_FORMATS["examples"]
        return cls(
            Planner(server, max_tokens=prompt_format.plan_tokens),
            Judge(server, max_tokens=prompt_format.verdict_tokens),
            prompt_format,
            server,
        )

    @property
    def where(self) -> str:
        """The name of the model on a server, or '' for the session's local model."""
        return self.server.name if self.server is not None else ""


class RoleAnswer(Protocol):
    """The answer of a role; `error` is the reason why it cannot be used, or ''."""

    @property
    def error(self) -> str:
        """The reason why the answer cannot be used, or ''."""
        ...


AnswerT = TypeVar("AnswerT", bound=RoleAnswer)


async def first_answer(
    models: Sequence[RoleModel],
    ask: Callable[[RoleModel], Awaitable[AnswerT]],
    failed: Callable[[RoleModel, str], None],
) -> AnswerT:
    """Return the first usable answer of `models`, or else the answer of the last model.

    `failed` is called with each earlier model that gives no usable answer, and the reason. If a
    request is interrupted, no other model is asked.
    """
    *before, last = models
    for model in before:
        answer = await ask(model)
        if answer.error in {"", CANCELLED}:
            return answer
        failed(model, answer.error)
    return await ask(last)
