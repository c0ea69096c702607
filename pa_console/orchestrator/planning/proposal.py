"""Steps 2 to 5 of a mission: from its words to what the planner answers, not examined yet."""

import asyncio
from collections.abc import Sequence
from dataclasses import replace
from itertools import islice
from time import perf_counter

from pa_console.llm.roles.grammar import CommandSlot, slot_grammar
from pa_console.llm.roles.planner import Proposal
from pa_console.orchestrator.mission.services import Payloads, Services, Stopwatch
from pa_console.orchestrator.planning.planner_question import Question, ask_for_plan
from pa_console.orchestrator.tasking.command_choices import commands_serving
from pa_console.orders.clause_grammar import grounded_reason
from pa_console.orders.reading import asked_words, read_asked
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan, Verb
from pa_console.schema.rule import RuleHit
from pa_console.schema.telemetry import Selection


class Proposing:
    """Retrieves rules and asks the planner; `latest` is its last whole answer.

    `task` is what the next plan is for: the mission itself, or a phase of its workflow.
    """

    latest: Proposal

    def __init__(self, services: Services, mission: Mission, stopwatch: Stopwatch) -> None:
        """Attempts are numbered from 1, the operator's own plans among them."""
        self._services, self._watch = services, stopwatch
        self.task = mission
        self._verbs: Sequence[Verb] = ()
        self.chosen = ""
        """What the operator says that the task asks; '' where the planner is to read it."""
        self.hits: tuple[RuleHit, ...] = ()
        self.question: Question | None = None
        self.attempts = 0
        self.confidence: dict[int, float | None] = {}
        """By attempt: the chance that the planner gave to what it says was asked."""
        self.others: list[tuple[int, Plan]] | None = None
        """Attempts that answer the same prompt and wait to be examined; None: not asked for."""

    @property
    def selection(self) -> Selection | None:
        """The part of the picture that the last prompt spoke of; None means all of it."""
        return self.question.digest.selection if self.question is not None else None

    async def retrieve(self, task: Mission, verbs: Sequence[Verb] = ()) -> Payloads:
        """Step 2: the rules that concern the words of `task`, and the pinned ones.

        With `verbs`, the planner is given no other commands for it.
        """
        if task.text != self.task.text:
            self.chosen = ""
        self.task, self._verbs = task, verbs
        started = perf_counter()
        retriever = self._services.retriever
        self.hits = self._retrieved(task.text)
        seconds = perf_counter() - started
        self._watch.add("retrieval_s", seconds)
        yield ev.RulesRetrieved(method=retriever.method, hits=self.hits, seconds=seconds)

    async def ask(self, reasons: Sequence[str], previous: str) -> Payloads:
        """Steps 3 to 5, once; `reasons` say what was wrong with the `previous` plan."""
        self.attempts += 1
        self.others = None
        services = self._services
        rules = [services.rulebook.get(hit.rule_id) for hit in self.hits]
        self.question = asked = ask_for_plan(
            services, self.task, rules, self._verbs, reasons, previous, self.chosen
        )
        self._watch.add("picture_s", asked.picture_s)
        self._watch.add("prompt_s", asked.prompt_s)
        yield ev.PictureDigested(digest=asked.digest, seconds=asked.picture_s)
        yield ev.PromptBuilt(
            role="planner",
            attempt=self.attempts,
            system=asked.prompt.system,
            user=asked.prompt.user,
            seconds=asked.prompt_s,
        )
        with self._watch.time("planning_s"):
            async for piece in services.planner.plan(asked.prompt, asked.grammar):
                if isinstance(piece, str):
                    yield ev.TextStreamed(role="planner", attempt=self.attempts, text=piece)
                else:
                    self.latest = replace(piece, confidence=None) if self.chosen else piece
                    yield self._proposed(self.latest)
        if self.attempts == 1:
            self._watch.add("first_token_s", self.latest.usage.first_token_s)

    async def ask_for_others(self, *, as_asked: bool = False) -> Payloads:
        """Step 5 once more, several answers at once: `others`, the likeliest first.

        With `as_asked` all of them say of what was asked what the last answer said. All of them are
        told. Asked for once a prompt; a plan of the operator's own has none.
        """
        asked, count = self.question, self._services.variant.candidates - 1
        if asked is None or self.others is not None:
            return
        self.others = []
        if count < 1:
            return
        first = self.attempts
        with self._watch.time("planning_s"):
            found, usage = await self._services.planner.several(
                asked.prompt, asked.grammar, count, self._asked if as_asked else ""
            )
        for proposal in found:
            self.attempts += 1
            given = replace(
                proposal,
                usage=usage if self.attempts == first + 1 else Usage(),
                confidence=self.latest.confidence if as_asked else None,
            )
            yield self._proposed(given, instead_of=first)
            if proposal.plan is not None:
                self.others.append((self.attempts, proposal.plan))

    async def other_readings(self, count: int) -> list[str]:
        """Return what else the planner might have said was asked, the likeliest first.

        At most `count` ways are looked at. Nothing where it does not say what was asked.
        """
        asked = self.question
        if asked is None or not asked.reasons or not self.said or count < 1:
            return []
        text = self.latest.text
        end = text.find(" ", len(self._asked))
        with self._watch.time("readings_s"):
            found, _ = await self._services.planner.readings(
                asked.prompt, asked.reasons, count, text[: end if end >= 0 else len(text)]
            )
        return found

    async def served(self, asked: str, most: int) -> list[tuple[CommandSlot, ...]]:
        """Return the commands of plans that serve what was `asked`, each with who may have it.

        None where the planner may give some commands only. In a large world it takes a while to
        find them, which the screen does not wait for.
        """
        fleet, reading = self._services.fleet, read_asked(asked)
        if reading is None or self._verbs:
            return []
        found = islice(commands_serving(reading, fleet.world, fleet.picture()), most)
        return await asyncio.to_thread(list, found)

    async def ask_who(
        self, asked: str, slots: Sequence[CommandSlot], *, as_judged: bool = False
    ) -> Payloads:
        """Step 5 once more, with the commands of `slots` given: who of those open to it has each.

        The plan, which says that this was `asked`, waits in `others`. With `as_judged` it is what
        the judge read in the mission.
        """
        question, fleet = self.question, self._services.fleet
        self.others = []
        if question is None:
            return
        reasons = grounded_reason(fleet.world, question.digest, self.task.text, asked)
        grammar = slot_grammar(slots, reasons)
        first = self.attempts
        with self._watch.time("planning_s"):
            async for piece in self._services.planner.plan(question.prompt, grammar):
                if not isinstance(piece, str):
                    self.attempts += 1
                    sure = None if as_judged else self.latest.confidence
                    given = replace(piece, confidence=sure)
                    told = self._proposed(given, instead_of=first, given=True)
                    yield told.model_copy(update={"as_judged": as_judged})
                    if piece.plan is not None:
                        self.others.append((self.attempts, piece.plan))

    async def take(self, plan: Plan) -> Payloads:
        """Take a plan that the operator wrote for an answer."""
        self.attempts += 1
        self.others = []
        yield ev.PlanProposed(attempt=self.attempts, author="operator", text=plan.answer, plan=plan)

    @property
    def said(self) -> str:
        """What was asked: as the operator says, or else the last answer; '' without that."""
        return self._words.rstrip("; ")

    @property
    def _asked(self) -> str:
        """The beginning of the last answer in which it says what was asked; '' without that."""
        text, words = self.latest.text, self._words
        return text[: text.find(words) + len(words)] if words and words in text else ""

    @property
    def _words(self) -> str:
        if self.question is not None and self.question.asked:
            return self.question.asked
        return asked_words(self.latest.plan.reason) if self.latest.plan is not None else ""

    def _retrieved(self, text: str) -> tuple[RuleHit, ...]:
        """Return the rules for the prompt: pinned ones, best ones, or both, by variant."""
        retriever, variant = self._services.retriever, self._services.variant
        top_k = self._services.top_k if variant.retrieval else 0
        if variant.pinned:
            return retriever.retrieve(text, top_k)
        best = retriever.score_all(text)[:top_k]
        return tuple(hit.model_copy(update={"pinned": False}) for hit in best)

    def _proposed(
        self, proposal: Proposal, instead_of: int | None = None, given: bool = False
    ) -> ev.PlanProposed:
        """Tell the last attempt, and note how sure its planner was."""
        self.confidence[self.attempts] = proposal.confidence
        return ev.PlanProposed(
            attempt=self.attempts,
            text=proposal.text,
            plan=proposal.plan,
            error=proposal.error,
            usage=proposal.usage,
            confidence=proposal.confidence,
            instead_of=instead_of,
            given=given,
            as_chosen=bool(self.chosen),
        )
