"""Step 2 of a mission: the reading of its words without a model."""

import asyncio
from dataclasses import dataclass, replace
from datetime import datetime
from time import perf_counter

from pa_console.language.canonical.reading import listed
from pa_console.language.clock_words import duration_words
from pa_console.language.demands import contradiction
from pa_console.language.mood import NoOrder, lasting_ban, no_order
from pa_console.language.orders.order_steps import ReadSteps, read_steps
from pa_console.language.orders.patrols import Patrol, least_s, read_patrol
from pa_console.language.orders.standing_orders import asks_nobody, read_standing
from pa_console.language.orders.timed_orders import read_timed, schedule_words
from pa_console.language.references.conversation import LEANING, ResolvedOrder, Unclear, leans
from pa_console.language.references.resolution import Answers, resolve, with_answers
from pa_console.language.references.scene import ReferenceScene
from pa_console.mission.context import MissionContext
from pa_console.mission.orders.agenda import Agenda
from pa_console.mission.orders.standing import StandingBan, Trigger, example_subject, starts_now
from pa_console.mission.spelling import question_back
from pa_console.policy.rule_checks import check_mission
from pa_console.policy.standing_conditions import StandingCondition
from pa_console.schema.events import event as ev
from pa_console.schema.mission import (
    MAX_MISSION_TEXT,
    Mission,
    Schedule,
    StandingOrder,
    StandingStart,
)

LAST_ORDER = "the order before"
"""The words for the previous order's commands in the list of references."""


@dataclass(frozen=True)
class RefusedMission:
    """A mission for which no plan may be made; `reason` names the rules."""

    reason: str


@dataclass(frozen=True)
class NotUnderstood:
    """A mission that is not clear as an order, and the `question` about it.

    If only some `words` are unclear, `choices` has their possible meanings.
    """

    question: str
    words: str = ""
    choices: tuple[str, ...] = ()
    describes: bool = False
    """True if the words describe assets, so that confident models may settle the question."""


@dataclass(frozen=True)
class Understood:
    """A mission that can be planned, with references replaced by names."""

    mission: Mission
    references: tuple[ev.Reference, ...] = ()
    undoes: bool = False
    """True if the mission takes back the last order."""
    corrects: bool = False
    """True if the mission replaces the last order."""
    steps: tuple[str, ...] = ()
    """The words of each step, if the order is in steps; each step is read when it is planned."""
    patrol: Patrol | None = None
    """The patrol, if the mission is one."""
    unsettled: NotUnderstood | None = None
    """The question to ask unless the models settle which assets the words describe."""

    @property
    def described(self) -> tuple[str, tuple[str, ...]]:
        """The unsettled words that describe an asset, and the assets that they may mean."""
        question = self.unsettled
        return (question.words, question.choices) if question is not None else ("", ())


@dataclass(frozen=True)
class StandingOffer:
    """A standing order to propose, with the missions that it would start `now`."""

    trigger: Trigger
    now: tuple[StandingStart, ...] = ()

    @property
    def order(self) -> StandingOrder:
        """The standing order to propose."""
        return self.trigger.order


async def understand(
    context: MissionContext, answers: Answers
) -> RefusedMission | NotUnderstood | Understood | StandingOffer:
    """Read a mission's words without a model (step 2).

    The rules on words may refuse the mission. Words that are not an order lead to a question. An
    order with a condition or a time becomes a standing order. `answers` are the operator's answers
    to questions about the words.
    """
    refused = await _refused(context, context.mission)
    if refused is not None or context.mission.source == "alarm":
        return refused or Understood(context.mission)
    if (mood := _no_order(context)) is not None:
        return _ban(context) or NotUnderstood(mood.question)
    if context.mission.source == "operator":
        standing = await _standing(context) or await _timed(context, answers)
        if standing is not None:
            return standing
    if (steps := _in_steps(context)) is not None:
        return steps
    if context.mission.agent and _is_for_later(context):
        return RefusedMission("an agent proposes no order that is to hold from now on")
    read = await asyncio.to_thread(_read, context, answers)
    if isinstance(read, NotUnderstood) and read.describes and not answers:
        read = Understood(context.mission, unsettled=read)
    if not isinstance(read, Understood):
        return read
    if read.mission is not context.mission and (refused := await _refused(context, read.mission)):
        return refused
    return _leaning(context, read)


def _leaning(context: MissionContext, read: Understood) -> Understood:
    """Return `read`, with the previous order's commands if its words still refer to that order."""
    scene, mission = _scene(context), read.mission
    if mission.source != "operator" or scene.last is None or not leans(scene, mission.text):
        return read
    before = scene.last.commands
    return replace(
        read,
        mission=mission.model_copy(update={"follows": before}),
        references=(*read.references, ev.Reference(said=LAST_ORDER, means=before)),
    )


def _no_order(context: MissionContext) -> NoOrder | None:
    """Return the sign that typed words are no order to carry out; None if they may be an order.

    The words of a standing order's missions are not tested, because they were approved with the
    standing order. Words that wait for a condition are an order if they are a standing order.
    """
    mission, scene = context.mission, _scene(context)
    if mission.source == "standing" or mission.proposed is not None:
        return None
    sign = no_order(scene.world, mission.text)
    if sign is not None and sign.kind == "waiting" and read_standing(scene, mission.text):
        return None
    return sign


def _ban(context: MissionContext) -> StandingOffer | None:
    """Return a lasting prohibition as a standing order to approve; None for any other text."""
    services, mission = context.services, context.mission
    if mission.source != "operator":
        return None
    ban = lasting_ban(services.fleet.world, mission.text)
    if ban is None:
        return None
    assets = listed(ban.assets) if ban.assets else "any asset"
    destination = f"to {listed(ban.places)}" if ban.places else "anywhere"
    order = StandingOrder(
        id=services.standing.new_id(),
        text=mission.said,
        ban=ban,
        words="from its approval on",
        order=f"no plan sends {assets} {destination}",
    )
    return StandingOffer(StandingBan(order))


def _in_steps(context: MissionContext) -> NotUnderstood | Understood | None:
    """Return an order in steps or a patrol, or a question about it; None for any other order.

    Returns None also for a mission that was proposed with a plan, which has its own steps.
    """
    mission, scene = context.mission, _scene(context)
    if mission.proposed is not None:
        return None
    limits = context.services.standing.limits.patrols
    sequence = read_steps(scene, mission.text) or read_patrol(scene, mission.text, limits)
    match sequence:
        case None:
            return None
        case Unclear(words, question, choices):
            return NotUnderstood(question, words, choices)
        case ReadSteps(steps):
            return Understood(mission, steps=steps)
        case Patrol():
            return Understood(mission, patrol=sequence)


def _is_for_later(context: MissionContext) -> bool:
    """Return whether the words are a standing order with a condition or a time."""
    services, text = context.services, context.mission.text
    now, shortest_s = services.standing.time.now, services.standing.limits.shortest_s
    timed = read_timed(services.fleet.world, text, now, {}, shortest_s)
    return timed is not None or read_standing(_scene(context), text) is not None


async def _standing(
    context: MissionContext,
) -> RefusedMission | NotUnderstood | StandingOffer | None:
    """Return a standing order with a condition, for approval, or its fault; None for other words.

    The order is read for one example subject. It must be readable, and the rules on words must not
    refuse it.
    """
    services, mission = context.services, context.mission
    standing = read_standing(services.scene, mission.text)
    if standing is None:
        return None
    if isinstance(standing, Unclear):
        return NotUnderstood(standing.question)
    order = StandingOrder(
        id=services.standing.new_id(),
        text=mission.said,
        each=standing.condition.subject_kind,
        condition=standing.condition.cel,
        words=standing.condition.words,
        order=standing.order,
        unasked=standing.unasked,
        most_an_hour=standing.most_an_hour,
    )
    world, picture = services.fleet.world, services.fleet.picture()
    try:
        condition = StandingCondition(order, world)
        now = starts_now(condition, picture)
    except ValueError as error:
        return NotUnderstood(f"its condition cannot be used: {error}")
    subject = example_subject(order, picture)
    typed = (
        standing if mission.said == mission.text else read_standing(services.scene, mission.said)
    )
    order_typed = standing.order if isinstance(typed, Unclear) or typed is None else typed.order
    example = order.model_copy(update={"order": order_typed}).order_for(*subject)
    words = {"text": order.order_for(*subject), "typed": example}
    sample = mission.model_copy(update=words)
    if refused := await _refused(context, sample):
        return refused
    read = await asyncio.to_thread(_read, replace(context, mission=sample), {})
    if isinstance(read, NotUnderstood) and not read.words:
        return NotUnderstood(f"what it orders is not understood: {read.question}")
    return StandingOffer(condition, now)


async def _timed(
    context: MissionContext, answers: Answers
) -> RefusedMission | NotUnderstood | StandingOffer | None:
    """Return a timed order, for approval, or its fault; None for an order without a time.

    References such as *it* are resolved once, now. Descriptions such as *the nearest drone* are
    resolved anew each time that the order starts a mission.
    """
    services, mission = context.services, context.mission
    standing, now = services.standing, services.standing.time.now
    text, unasked = asks_nobody(mission.text)
    timed = read_timed(services.fleet.world, text, now, answers, standing.limits.shortest_s)
    if timed is None:
        return None
    if isinstance(timed, Unclear):
        return NotUnderstood(timed.question, timed.words, timed.choices)
    if problem := _time_of_a_step(_scene(context), mission.text, timed.order, now):
        return NotUnderstood(problem)
    sample = mission.model_copy(update={"text": timed.order, "typed": ""})
    if refused := await _refused(context, sample):
        return refused
    trial = replace(context, mission=sample)
    read = _in_steps(trial) or await asyncio.to_thread(_read, trial, answers)
    if isinstance(read, Understood) and read.patrol is not None:
        read = _timed_patrol(_scene(context), timed.schedule, read, read.patrol)
    if isinstance(read, NotUnderstood):
        if read.words:
            return read
        whole = "Say the whole order anew, with its time."
        return NotUnderstood(f"what it orders is not understood: {read.question} {whole}")
    leans = read.undoes or any(reference.said.lower() in LEANING for reference in read.references)
    order = StandingOrder(
        id=standing.new_id(),
        text=mission.said,
        schedule=timed.schedule,
        words=schedule_words(timed.schedule, now),
        order=read.mission.text if leans else timed.order,
        unasked=unasked,
    )
    return StandingOffer(Agenda(order), (StandingStart(order=read.mission.text),))


def _timed_patrol(
    scene: ReferenceScene, schedule: Schedule, read: Understood, patrol: Patrol
) -> Understood | NotUnderstood:
    """Return the order as it was `read` if the schedule suits the patrol, otherwise a question."""
    takes_s = least_s(patrol, scene)
    if 0.0 < schedule.every_s < takes_s:
        every, least = duration_words(schedule.every_s), duration_words(round(takes_s))
        problem = f"every {every} is too often: the patrol takes at least {least}."
        return NotUnderstood(f"{problem} How often, or over fewer places?")
    if schedule.stays:
        return NotUnderstood("a patrol ends after its laps, not after a time. How many laps?")
    return read


def _time_of_a_step(scene: ReferenceScene, text: str, order: str, now: datetime) -> str:
    """Return the question about a time in a later step of an order; '' if no such step has one."""
    whole, rest = read_steps(scene, text), read_steps(scene, order)
    if not isinstance(whole, ReadSteps) or not isinstance(rest, ReadSteps):
        return ""
    late = [step for step in whole.steps[1:] if read_timed(scene.world, step, now) is not None]
    if not late or len(whole.steps) != len(rest.steps):
        return ""
    return f"“{late[0]}” has a time of its own: give it as an order of its own, or none for it."


def _read(context: MissionContext, answers: Answers) -> NotUnderstood | Understood:
    """Return the mission with names in place of references, or a question about its words."""
    services, mission = context.services, context.mission
    world, rules = services.fleet.world, services.rulebook
    resolved = resolve(_scene(context), mission.text, answers)
    text = resolved.text if isinstance(resolved, ResolvedOrder) else mission.text
    if isinstance(resolved, Unclear) and resolved.choices:
        # Unresolved, *Send it home* would name nothing of this site.
        text = with_answers(text, {resolved.words: resolved.choices[0]})
    if question := question_back(mission.said, text, world, rules):
        return NotUnderstood(question)
    for words in dict.fromkeys((mission.text, text)):
        if (excluded := contradiction(world, words)) is not None:
            return NotUnderstood(excluded.question)
    if isinstance(resolved, Unclear):
        return NotUnderstood(
            resolved.question, resolved.words, resolved.choices, resolved.describes
        )
    if resolved.text == mission.text or len(resolved.text) > MAX_MISSION_TEXT:
        return Understood(mission)
    references = tuple(
        ev.Reference(said=phrase, means=means) for phrase, means in resolved.meanings
    )
    read = mission.model_copy(update={"text": resolved.text, "typed": mission.said})
    return Understood(read, references, resolved.undoes, resolved.corrects)


def _scene(context: MissionContext) -> ReferenceScene:
    """Return the scene for references; an agent cannot refer to earlier orders or the mark."""
    scene = context.services.scene
    return replace(scene, past=(), pointer="") if context.mission.agent else scene


async def _refused(context: MissionContext, mission: Mission) -> RefusedMission | None:
    services = context.services
    if not services.variant.checks:
        return None
    started = perf_counter()
    findings = await asyncio.to_thread(
        check_mission, services.rulebook, mission, services.fleet.world
    )
    seconds = perf_counter() - started
    context.stopwatch.add("checks_s", seconds)
    blocking = [f"{f.rule_id}: {f.message}" for f in findings if f.blocking]
    if not blocking:
        return None
    context.emit(ev.PlanChecked(attempt=1, findings=findings, seconds=seconds))
    return RefusedMission("; ".join(blocking))
