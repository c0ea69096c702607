"""The judge role (paper, Section IV-F): an independent verdict on a plan or an outcome."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from pydantic import Field, ValidationError

from pa_console.llm.backend import Answerer, ModelAnswer, OnText, Request, ask_model, confidence
from pa_console.llm.roles.grammar import COMPARED_CHARS, PLANNED, Schema
from pa_console.llm.roles.prompts import Prompt
from pa_console.schema.base import StrictModel
from pa_console.schema.finding import JudgeOpinion, RuleOpinion, Usage, Verdict

MAX_TOKENS = 900
DEADLINE_S = 60.0


@dataclass(frozen=True)
class Judgement:
    """The judge's whole answer; if `verdict` is None, `error` says why there is no verdict."""

    text: str
    verdict: Verdict | None
    error: str = ""
    usage: Usage = field(default_factory=Usage)
    confidence: float | None = None
    """The confidence in the reading at the beginning of the answer, 0 to 1. It is None if the
    beginning was not requested separately."""


@dataclass(frozen=True)
class JudgeQuestion:
    """A prompt for the judge and the grammar of its answer, with opinions on `rule_ids`.

    `role` selects the fixed part of the prompt: for plans or for outcomes. No caller waits for a
    verdict on an outcome, so its prompt yields to prompts that a caller waits for.
    """

    role: Literal["judge", "outcome"]
    prompt: Prompt
    grammar: str
    rule_ids: tuple[str, ...] = ()
    goes_on: Callable[[str], str] | None = None
    """A function from the answer's beginning to the grammar of the whole answer; None if `grammar`
    already covers the whole answer."""
    hint: str = ""
    """The planner's reading, which the answer may repeat. The hint only saves time; without it, the
    judge writes the same answer."""
    schema: Schema | None = None
    """The JSON schema for a model on a server, in place of `grammar`."""


@dataclass(frozen=True)
class OrderReading:
    """A model's reading of an order, and its confidence in it, 0 to 1."""

    asked: str
    error: str = ""
    usage: Usage = field(default_factory=Usage)
    confidence: float | None = None
    text: str = ""
    """The part of the answer that was received."""
    fatal: bool = False
    """True if another attempt would not help."""


class Judge:
    """A judge of plans, with the model of `engine`; each answer may take `deadline_s` seconds."""

    def __init__(
        self, engine: Answerer, *, max_tokens: int = MAX_TOKENS, deadline_s: float = DEADLINE_S
    ) -> None:
        self._engine, self._max_tokens, self._deadline_s = engine, max_tokens, deadline_s

    @property
    def model(self) -> str:
        """The name of the model that answers."""
        return self._engine.name

    async def judge(self, question: JudgeQuestion, on_text: OnText | None = None) -> Judgement:
        """Return the judgement; `on_text` gets the answer in pieces. Never raises EngineError."""
        grammar, text = question.grammar, ""
        begun: ModelAnswer | None = None
        if question.goes_on is not None:
            begun = await self._ask(question, grammar, on_text=on_text)
            if begun.error:
                return Judgement(begun.text, None, begun.error, begun.usage)
            grammar, text = question.goes_on(begun.text), begun.text
        whole = await self._ask(question, grammar, text, on_text)
        verdict, error = (
            (None, whole.error) if whole.error else read_verdict(whole.text, question.rule_ids)
        )
        if begun is None:
            return Judgement(whole.text, verdict, error, whole.usage)
        sure = confidence(begun.chances, begun.text, begun.text)
        return Judgement(whole.text, verdict, error, begun.usage.going_on(whole.usage), sure)

    async def read(self, question: JudgeQuestion) -> OrderReading:
        """Return the judge's reading, which begins its answer; never raises EngineError."""
        begun = await self._ask(question, question.grammar)
        if begun.error:
            return OrderReading("", begun.error, begun.usage)
        reading = begun.text.partition(': "')[2].removesuffix(PLANNED)
        return OrderReading(
            reading, "", begun.usage, confidence(begun.chances, begun.text, begun.text)
        )

    async def _ask(
        self, question: JudgeQuestion, grammar: str, begun: str = "", on_text: OnText | None = None
    ) -> ModelAnswer:
        """Request an answer that begins with `begun`, and pass only the rest to `on_text`."""
        request = Request(
            question.role,
            question.prompt.system,
            question.prompt.user,
            grammar,
            self._max_tokens,
            self._deadline_s,
            hint=question.hint,
            begun=begun,
            schema=question.schema,
            yields=question.role == "outcome",
        )
        return await ask_model(self._engine, request, on_text)


class _Opinion(StrictModel):
    id: str
    verdict: JudgeOpinion


class _JudgeAnswer(StrictModel):
    """The judge's answer in JSON; opinions come first, so that the verdict depends on them.

    A short verdict has the feedback first, followed only by the ids of violated rules.
    """

    rules: tuple[_Opinion, ...] = ()
    feedback: str = Field(max_length=COMPARED_CHARS)
    violated: tuple[str, ...] | None = None
    verdict: Literal["Success", "Failure"]


def read_verdict(text: str, rule_ids: Sequence[str] = ()) -> tuple[Verdict | None, str]:
    """Return the verdict in `text` and '', or None and the first problem with it.

    In a short verdict, a rule of `rule_ids` complies if it is not listed as violated.
    """
    try:
        answer = _JudgeAnswer.model_validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"]))
        return None, f"the answer is not a verdict: {field + ': ' if field else ''}{first['msg']}"
    opinions = [RuleOpinion(rule_id=rule.id, opinion=rule.verdict) for rule in answer.rules]
    if answer.violated is not None:
        named = dict.fromkeys(answer.violated)
        kept = [rule_id for rule_id in rule_ids if rule_id not in named]
        opinions += [RuleOpinion(rule_id=rule_id, opinion="violates") for rule_id in named]
        opinions += [RuleOpinion(rule_id=rule_id, opinion="complies") for rule_id in kept]
    verdict = Verdict(verdict=answer.verdict, rules=tuple(opinions), feedback=answer.feedback)
    return verdict, ""
