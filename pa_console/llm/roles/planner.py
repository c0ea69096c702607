"""The planner role: it answers a prompt with text in pieces, then a plan or an error."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from json import JSONDecoder

from pydantic import ValidationError

from pa_console.language.canonical.reading import asked_words
from pa_console.llm.backend import Answerer, OnText, Request, ask_model, confidence
from pa_console.llm.roles.clause_reader import ClauseReader
from pa_console.llm.roles.grammar import READ, Schema, begun_reason, reason_grammar
from pa_console.llm.roles.prompts import Prompt
from pa_console.schema.finding import Usage
from pa_console.schema.plan import Action, Plan

MAX_TOKENS = 700
REASON_TOKENS = 114
"""The token limit of a reason that is written to find other readings."""
DEADLINE_S = 60.0


@dataclass(frozen=True)
class Proposal:
    """The planner's whole answer; if `plan` is None, `error` has the reason for a hold.

    `fatal` is True if another attempt would not help, because the request was cancelled or took too
    long, or because the engine failed.
    """

    text: str
    plan: Plan | None
    error: str = ""
    fatal: bool = False
    usage: Usage = field(default_factory=Usage)
    confidence: float | None = None
    """The confidence in the planner's reading, 0 to 1; None if the plan has no reading."""


class Planner:
    """A writer of plans, with the model of `engine`; each answer may take `deadline_s` seconds."""

    def __init__(
        self, engine: Answerer, *, max_tokens: int = MAX_TOKENS, deadline_s: float = DEADLINE_S
    ) -> None:
        self._engine, self._max_tokens, self._deadline_s = engine, max_tokens, deadline_s

    @property
    def reader(self) -> ClauseReader:
        """A reader with the same model, which returns only the reading of an order."""
        return ClauseReader(self._engine, "planner", deadline_s=self._deadline_s)

    async def plan(
        self,
        prompt: Prompt,
        grammar: str,
        on_text: OnText | None = None,
        schema: Schema | None = None,
    ) -> Proposal:
        """Return the proposal; `on_text` gets the answer in pieces. Never raises EngineError.

        A model on a server is constrained by `schema`, if the server supports it, and not by
        `grammar`.
        """
        request = self._request(prompt, grammar, schema=schema)
        answer = await ask_model(self._engine, request, on_text)
        if answer.error:
            return Proposal(answer.text, None, answer.error, answer.fatal, answer.usage)
        plan, error = read_plan(answer.text)
        reading = asked_words(plan.reason) if plan is not None else ""
        sure = confidence(answer.chances, answer.text, reading)
        return Proposal(answer.text, plan, error, usage=answer.usage, confidence=sure)

    async def several(
        self, prompt: Prompt, grammar: str, count: int, begun: str = ""
    ) -> tuple[list[Proposal], Usage]:
        """Return up to `count` other plans for `prompt`, the likeliest first.

        They begin with `begun`, the beginning of the most likely answer. The returned usage covers
        all of them; the usage of each Proposal is empty. Never raises EngineError.
        """
        request = self._request(prompt, grammar, count=count, begun=begun)
        answer = await ask_model(self._engine, request)
        plans: dict[tuple[Action, ...], Proposal] = {}
        for text in answer.texts:
            plan, _ = read_plan(text)
            if plan is not None:
                plans.setdefault(plan.actions, Proposal(text, plan))
        return list(plans.values()), answer.usage

    async def readings(
        self, prompt: Prompt, reasons: Sequence[str], count: int, within: str = ""
    ) -> tuple[list[str], Usage]:
        """Return the planner's other readings of `prompt`, the likeliest first.

        In addition to the most likely reason, the beginnings of `count` other reasons are written.
        They match `reasons`, and differ from the most likely one before the end of its beginning
        `within`. Each reading is returned once, in canonical words, with the usage of all of them.
        Never raises EngineError.
        """
        request = self._request(prompt, reason_grammar(reasons), count=count)
        most = min(self._max_tokens, REASON_TOKENS)
        reading_request = replace(request, max_tokens=most, within=within, stop=READ)
        answer = await ask_model(self._engine, reading_request)
        readings = (asked_words(begun_reason(text)) for text in answer.texts)
        return list(dict.fromkeys(words.rstrip("; ") for words in readings if words)), answer.usage

    def _request(
        self,
        prompt: Prompt,
        grammar: str,
        *,
        count: int = 1,
        begun: str = "",
        schema: Schema | None = None,
    ) -> Request:
        most, within_s = self._max_tokens, self._deadline_s
        return Request(
            "planner", prompt.system, prompt.user, grammar, most, within_s, count,
            begun=begun, schema=schema,
        )  # fmt: skip


def read_plan(text: str) -> tuple[Plan | None, str]:
    """Return the plan in `text` and '', or None and the first problem with it.

    Words around the JSON object, or a fence, are ignored, because models without a grammar write
    them.
    """
    begin = text.find("{")
    try:
        _, end = JSONDecoder().raw_decode(text, max(begin, 0))
    except ValueError:
        end = len(text)
    try:
        return Plan.model_validate_json(text[max(begin, 0) : end]), ""
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(map(str, first["loc"]))
        return None, f"the answer is not a plan: {field + ': ' if field else ''}{first['msg']}"
