"""The judge role (paper, Section IV-F): an independent verdict on a plan or an outcome."""

from collections.abc import AsyncGenerator, Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from pydantic import Field, ValidationError

from pa_console.llm.engine.engine import Engine
from pa_console.llm.engine.protocol import Request, confidence
from pa_console.llm.roles.engine_call import ModelAnswer, ask_model
from pa_console.llm.roles.grammar import COMPARED_CHARS
from pa_console.llm.roles.prompts import Prompt
from pa_console.schema.base import StrictModel
from pa_console.schema.events.event import Role
from pa_console.schema.finding import JudgeOpinion, RuleOpinion, Usage, Verdict

MAX_TOKENS = 900
DEADLINE_S = 60.0


@dataclass(frozen=True)
class Judgement:
    """The judge's whole answer; `verdict` None means hold, `error` says why."""

    text: str
    verdict: Verdict | None
    error: str = ""
    usage: Usage = field(default_factory=Usage)
    confidence: float | None = None
    """The chance, 0 to 1, that it gave to the beginning of its answer, where that was asked for
    by itself: to what it says was asked."""


class Judge:
    """Judges plans with the model of `engine`, each within `deadline_s` seconds."""

    def __init__(
        self, engine: Engine, *, max_tokens: int = MAX_TOKENS, deadline_s: float = DEADLINE_S
    ) -> None:
        self._engine, self._max_tokens, self._deadline_s = engine, max_tokens, deadline_s

    async def judge(  # noqa: PLR0917
        self,
        prompt: Prompt,
        grammar: str,
        role: Role = "judge",
        rule_ids: Sequence[str] = (),
        goes_on: Callable[[str], str] | None = None,
        hint: str = "",
    ) -> AsyncGenerator[str | Judgement]:
        """Give the answer to `prompt` in pieces, then one Judgement; never raises EngineError.

        `role` says whose fixed part the prompt begins with: of plans, or of outcomes. `rule_ids`
        are the rules on which an opinion is wanted. With `goes_on`, `grammar` is of the beginning
        of the answer; given that, it returns the grammar of the whole, which begins with it.
        `hint` is what the answer may repeat: it makes it faster and nothing else.
        """
        begun: ModelAnswer | None = None
        if goes_on is not None:
            async for item in self._ask(prompt, grammar, role, hint):
                if isinstance(item, str):
                    yield item
                    continue
                if item.error:
                    yield Judgement(item.text, None, item.error, item.usage)
                    return
                begun, grammar = item, goes_on(item.text)
        said = begun.text if begun is not None else ""
        text, given = "", len(said)
        async for item in self._ask(prompt, grammar, role, hint, said):
            if isinstance(item, str):
                text += item
                if len(text) > given:
                    yield text[given:]
                    given = len(text)
                continue
            usage = item.usage if begun is None else begun.usage.going_on(item.usage)
            sure = confidence(begun.chances, begun.text, begun.text) if begun is not None else None
            verdict, error = (None, item.error) if item.error else read_verdict(item.text, rule_ids)
            yield Judgement(item.text, verdict, error, usage, sure)

    def _ask(
        self, prompt: Prompt, grammar: str, role: Role, hint: str, begun: str = ""
    ) -> AsyncGenerator[str | ModelAnswer]:
        request = Request(
            role,
            prompt.system,
            prompt.user,
            grammar,
            self._max_tokens,
            self._deadline_s,
            hint=hint,
            begun=begun,
        )
        return ask_model(self._engine, request)


class _Opinion(StrictModel):
    id: str
    verdict: JudgeOpinion


class _Answer(StrictModel):
    """The JSON that the judge writes, opinions first so that the verdict rests on them.

    A short verdict has only the ids of violated rules, after the feedback.
    """

    rules: tuple[_Opinion, ...] = ()
    feedback: str = Field(max_length=COMPARED_CHARS)
    violated: tuple[str, ...] | None = None
    verdict: Literal["Success", "Failure"]


def read_verdict(text: str, rule_ids: Sequence[str] = ()) -> tuple[Verdict | None, str]:
    """Return the verdict that `text` holds, or None and the first thing wrong with it.

    In a short verdict, those of `rule_ids` that are not named as violated comply.
    """
    try:
        answer = _Answer.model_validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        return None, f"the answer is not a verdict: {where + ': ' if where else ''}{first['msg']}"
    opinions = [RuleOpinion(rule_id=rule.id, opinion=rule.verdict) for rule in answer.rules]
    if answer.violated is not None:
        named = dict.fromkeys(answer.violated)
        kept = [rule_id for rule_id in rule_ids if rule_id not in named]
        opinions += [RuleOpinion(rule_id=rule_id, opinion="violates") for rule_id in named]
        opinions += [RuleOpinion(rule_id=rule_id, opinion="complies") for rule_id in kept]
    verdict = Verdict(verdict=answer.verdict, rules=tuple(opinions), feedback=answer.feedback)
    return verdict, ""
