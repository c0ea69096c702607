"""Steps 3 and 4 of a mission: the question for the planner, and its answer."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from time import perf_counter

from pa_console.language.canonical.facts import asset_state
from pa_console.language.canonical.reading import asked_words, read_asked
from pa_console.language.clause_grammar import asked_now, grounded_reason
from pa_console.language.exclusions import excluded_names
from pa_console.llm.backend import OnText
from pa_console.llm.roles.clause_reader import ReadingQuestion
from pa_console.llm.roles.grammar import (
    ANY_TEXT,
    CommandSlot,
    Schema,
    begun_grammar,
    plan_grammar,
    plan_schema,
    slot_grammar,
    slot_schema,
)
from pa_console.llm.roles.planner import Proposal
from pa_console.llm.roles.prompts import Prompt, paper_prompt
from pa_console.llm.roles.role_model import RoleModel, first_answer
from pa_console.mission.context import MissionContext, Services
from pa_console.mission.planning.choices import commands_serving
from pa_console.mission.planning.picture_text import LESS, digest_picture, select
from pa_console.mission.retrieve import RetrievedRules
from pa_console.schema.command import Verb
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage
from pa_console.schema.plan import MAX_REASON, Action, Plan
from pa_console.schema.telemetry import Digest, Picture, Selection
from pa_console.session.confidence import Reader

MOST_FACTS = 4
"""The number of assets whose state is described in a plan's reason."""


def served_plan(reading: str, slots: Sequence[CommandSlot], digest: Digest) -> Plan:
    """Return the plan with the commands of `slots`, each given to its first candidate.

    The reason begins with the `reading` and continues with the state of the commanded assets.
    """
    actions = tuple(Action(agent=slot.agents[0], command=slot.command) for slot in slots)
    named = list(dict.fromkeys(action.agent for action in actions))[:MOST_FACTS]
    facts = ", ".join(f"{name}: {asset_state(digest, name)}" for name in named)
    return Plan(reason=f"{reading}; {facts or 'nobody to send'}"[:MAX_REASON], actions=actions)


def still(picture: Picture) -> tuple[CommandSlot, ...]:
    """Return a hold for one asset: the plan if no part of the reading can be carried out."""
    up = (name for name, asset in picture.assets.items() if asset.available)
    return tuple(CommandSlot((name,), "hold") for name in list(up)[:1])


@dataclass(frozen=True)
class PlanQuestion:
    """A prompt for the planner, the `digest` in the prompt, and the grammar of the answer.

    The reason in the answer matches the regular expressions `reasons`. It begins with the reading
    `asked`, unless that is ''.
    """

    digest: Digest
    prompt: Prompt
    grammar: str
    reasons: tuple[str, ...]
    asked: str
    picture_s: float
    prompt_s: float
    schema: Schema | None = None
    """The JSON schema for a model on a server, in place of the grammar."""


@dataclass(frozen=True)
class NumberedPlan:
    """A plan with its number in the mission, and the planner's `confidence` in its reading."""

    number: int
    plan: Plan
    confidence: float | None = None
    by_server: bool = False
    """True if a model on a server wrote the plan."""


@dataclass(frozen=True)
class PlannerAnswer:
    """A question about a task, and the complete answer of `model`; `attempt` is its number."""

    model: RoleModel
    retrieved: RetrievedRules
    question: PlanQuestion
    proposal: Proposal
    attempt: int

    @property
    def error(self) -> str:
        """The reason why the answer has no plan; '' if it has a plan."""
        return self.proposal.error if self.proposal.plan is None else ""

    @property
    def selection(self) -> Selection | None:
        """The part of the picture that is in the prompt; None for all of it."""
        return self.question.digest.selection

    @property
    def reading(self) -> str:
        """The reading that the operator confirmed, or else the one in the answer; '' if none."""
        return self._words.rstrip("; ")

    @property
    def begun(self) -> str:
        """The answer up to the end of its reading; '' if it has no reading."""
        text = self.proposal.text
        words = next((words for words in (self._words, self.reading) if words in text), "")
        return text[: text.find(words) + len(words)]

    @property
    def _words(self) -> str:
        if self.question.asked:
            return self.question.asked
        plan = self.proposal.plan
        return asked_words(plan.reason) if plan is not None else ""


def ask_for_plan(
    services: Services,
    retrieved: RetrievedRules,
    reasons: Sequence[str] = (),
    previous: str = "",
    model: RoleModel | None = None,
) -> PlanQuestion:
    """Return the question for a plan; `reasons` are the faults of the `previous` plan.

    The question is for `model`, by default the local model. Its prompt has as much of the picture
    as leaves room for the answer.
    """
    prompt_format = model.prompt_format if model is not None else services.prompt_format
    started = perf_counter()
    picture, world, task = services.fleet.picture(), services.fleet.world, retrieved.task
    rules = [services.rulebook.get(hit.rule_id) for hit in retrieved.hits]

    def tell(share: float = 1.0) -> tuple[Digest, float, Prompt]:
        digest = digest_picture(picture, world, select(picture, world, task, rules, share))
        digested = perf_counter()
        if services.variant.prompt == "paper":
            return digest, digested, paper_prompt(world, digest, rules, task)
        prompt = prompt_format.planner(world, digest, rules, task, reasons, previous)
        return digest, digested, prompt

    digest, digested, prompt = tell()
    if model is None or model.server is None:
        room = services.engine.model.n_ctx - prompt_format.plan_tokens
        for share in LESS:
            if prompt.tokens <= room:
                break
            digest, digested, prompt = tell(share)
    grammar, stated, reading = ANY_TEXT, (), asked_now(world, digest, retrieved.chosen)
    schema: Schema | None = None
    if prompt_format.served:
        stated = tuple(prompt_format.reason(world, digest, task.text, reading))
        grammar = begun_grammar(stated)
    elif services.variant.grammar:
        selection = digest.selection
        shown = (None, None) if selection is None else (selection.assets, selection.frames)
        if services.variant.grounded:
            stated = tuple(prompt_format.reason(world, digest, task.text, reading))
        grammar = plan_grammar(world, picture, *shown, retrieved.verbs, stated)
        if model is not None and model.server is not None:
            schema = plan_schema(world, picture, *shown, retrieved.verbs)
    spent_s = perf_counter() - digested
    return PlanQuestion(
        digest, prompt, grammar, stated, reading, digested - started, spent_s, schema
    )


async def ask_planner(
    context: MissionContext, retrieved: RetrievedRules, reasons: Sequence[str], previous: str
) -> PlannerAnswer:
    """Ask the planner once (steps 3 and 4); `reasons` are the faults of the `previous` plan.

    If a model on a server returns no plan, the local model plans instead.
    """
    attempt, watch, emit = context.next_attempt(), context.stopwatch, context.emit

    def on_text(piece: str) -> None:
        emit(ev.TextStreamed(role="planner", attempt=attempt, text=piece))

    async def ask(model: RoleModel) -> PlannerAnswer:
        question = ask_for_plan(context.services, retrieved, reasons, previous, model)
        prompt = question.prompt
        watch.add("picture_s", question.picture_s)
        watch.add("prompt_s", question.prompt_s)
        emit(ev.PictureDigested(digest=question.digest, seconds=question.picture_s))
        emit(
            ev.PromptBuilt(
                role="planner",
                attempt=attempt,
                system=prompt.system,
                user=prompt.user,
                seconds=question.prompt_s,
                server=model.where,
            )
        )
        with watch.time("planning_s"):
            if model.prompt_format.served:
                proposal = await _served(context, model, retrieved, question, on_text)
            else:
                proposal = await model.planner.plan(
                    prompt, question.grammar, on_text, question.schema
                )
        if retrieved.chosen:
            proposal = replace(proposal, confidence=None)
        return PlannerAnswer(model, retrieved, question, proposal, attempt)

    answered = await first_answer(context.services.planners, ask, context.turn_to_own)
    emit(_proposed(answered, answered.proposal, attempt))
    if attempt == 1:
        usage = answered.proposal.usage
        watch.add("first_token_s", max(0.0, usage.first_token_s - usage.ahead_s))
    return answered


def without_planner(context: MissionContext, retrieved: RetrievedRules) -> PlannerAnswer:
    """Return an answer for a plan that no planner wrote; no model is asked."""
    model = context.services.planners[0]
    question = ask_for_plan(context.services, retrieved, model=model)
    context.stopwatch.add("picture_s", question.picture_s)
    context.emit(ev.PictureDigested(digest=question.digest, seconds=question.picture_s))
    return PlannerAnswer(model, retrieved, question, Proposal("", None), 0)


async def _served(
    context: MissionContext,
    model: RoleModel,
    retrieved: RetrievedRules,
    question: PlanQuestion,
    on_text: OnText,
) -> Proposal:
    """Ask `model` for a reading, and make the plan for that reading."""
    reading_question = ReadingQuestion(question.prompt, question.reasons)
    read = await model.planner.reader.read(reading_question, on_text)
    if read.error:
        return Proposal(read.text, None, read.error, read.fatal, read.usage)
    ways = await commands_for(context, retrieved, read.asked, 1, retrieved.verbs)
    slots = ways[0] if ways else still(context.services.fleet.picture())
    made = served_plan(read.asked, slots, question.digest)
    return Proposal(read.text, made, usage=read.usage, confidence=read.confidence)


async def ask_for_others(
    context: MissionContext, answered: PlannerAnswer, *, as_asked: bool = False
) -> list[NumberedPlan]:
    """Ask for several answers at once (step 4); return the other plans, most likely first.

    With `as_asked`, all answers have the reading of the first one. Each answer is emitted. The list
    is empty if the console makes the plans.
    """
    question, count = answered.question, context.services.variant.candidates - 1
    if count < 1 or answered.model.prompt_format.served:
        return []
    first = context.attempts
    with context.stopwatch.time("planning_s"):
        proposals, usage = await answered.model.planner.several(
            question.prompt, question.grammar, count, answered.begun if as_asked else ""
        )
    others: list[NumberedPlan] = []
    for proposal in proposals:
        number = context.next_attempt()
        shown = replace(
            proposal,
            usage=usage if number == first + 1 else Usage(),
            confidence=answered.proposal.confidence if as_asked else None,
        )
        context.emit(_proposed(answered, shown, number, instead_of=first))
        if shown.plan is not None:
            by_server = answered.model.server is not None
            others.append(NumberedPlan(number, shown.plan, shown.confidence, by_server))
    return others


async def other_readings(context: MissionContext, answered: PlannerAnswer, count: int) -> list[str]:
    """Return the planner's other likely readings, the likeliest first.

    At most `count` readings are tried. The list is empty if the planner's answer has no reading.
    """
    question = answered.question
    if not question.reasons or not answered.reading or count < 1:
        return []
    text = answered.proposal.text
    end = text.find(" ", len(answered.begun))
    with context.stopwatch.time("readings_s"):
        readings, _ = await answered.model.planner.readings(
            question.prompt, question.reasons, count, text[: end if end >= 0 else len(text)]
        )
    return readings


async def commands_for(
    context: MissionContext,
    retrieved: RetrievedRules,
    reading_text: str,
    most: int,
    verbs: Sequence[Verb] = (),
) -> list[tuple[CommandSlot, ...]]:
    """Return the ways to serve a reading: tuples of commands with their candidate agents.

    At most `most` ways are returned. If `verbs` are given, ways with other commands are excluded.
    The search runs in a thread, because it takes a while in a large world.
    """
    fleet, reading = context.services.fleet, read_asked(reading_text)
    if reading is None or (retrieved.verbs and not verbs):
        return []
    texts = {retrieved.task.text, context.mission.text}
    excluded = [name for text in texts for name in excluded_names(fleet.world, text)]
    reading = reading._replace(excluded=tuple(dict.fromkeys((*reading.excluded, *excluded))))
    ways = (
        slots
        for slots in commands_serving(reading, fleet.world, fleet.picture())
        if not verbs or all(slot.verb in verbs for slot in slots)
    )
    return await asyncio.to_thread(list, islice(ways, most))


async def ask_who(
    context: MissionContext,
    answered: PlannerAnswer,
    reading: str,
    slots: Sequence[CommandSlot],
    reader: Reader = "planner",
) -> NumberedPlan | None:
    """Ask the planner to assign an agent to each command of `slots` (step 4).

    The plan is for the `reading` of the model `reader`. If the console makes the plans, it also
    assigns the agents. Returns None if the answer has no plan.
    """
    first = context.attempts
    by_server = answered.model.server is not None
    with context.stopwatch.time("planning_s"):
        proposal = await _given_commands(context, answered, reading, slots)
        number = context.next_attempt()
        own = reader == "planner"
        sure = answered.proposal.confidence if own else None
        shown = replace(proposal, confidence=sure)
        event = _proposed(answered, shown, number, instead_of=first, given=True)
        origin = {"as_judged": reader == "judge", "as_read_again": reader == "second"}
        context.emit(event.model_copy(update=origin))
    return (
        NumberedPlan(number, shown.plan, sure, by_server and own)
        if shown.plan is not None
        else None
    )


def propose_instead(context: MissionContext, answered: PlannerAnswer, plan: Plan) -> NumberedPlan:
    """Emit a `plan` that the console has made from the planner's answer, and return it."""
    first, by_server = context.attempts, answered.model.server is not None
    number, sure = context.next_attempt(), answered.proposal.confidence
    proposal = Proposal(plan.answer, plan, confidence=sure)
    context.emit(_proposed(answered, proposal, number, instead_of=first, given=True))
    return NumberedPlan(number, plan, sure, by_server)


async def _given_commands(
    context: MissionContext, answered: PlannerAnswer, reading: str, slots: Sequence[CommandSlot]
) -> Proposal:
    """Return a plan for the `reading` with the commands of `slots`."""
    model, question, task = answered.model, answered.question, answered.retrieved.task
    if model.prompt_format.served:
        made = served_plan(reading, slots, question.digest)
        return Proposal(made.answer, made)
    world = context.services.fleet.world
    grammar = slot_grammar(slots, grounded_reason(world, question.digest, task.text, reading))
    schema = slot_schema(slots, reading) if model.server is not None else None
    return await model.planner.plan(question.prompt, grammar, schema=schema)


def _proposed(
    answered: PlannerAnswer,
    proposal: Proposal,
    attempt: int,
    *,
    instead_of: int | None = None,
    given: bool = False,
) -> ev.PlanProposed:
    return ev.PlanProposed(
        attempt=attempt,
        text=proposal.text,
        plan=proposal.plan,
        error=proposal.error,
        usage=proposal.usage,
        confidence=proposal.confidence,
        instead_of=instead_of,
        given=given,
        as_chosen=bool(answered.retrieved.chosen),
    )
