"""The services that missions share, and the context of the steps of one mission."""

import re
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import TYPE_CHECKING, Self

from pa_console.fleets.fleet import Fleet
from pa_console.fleets.simulated import ForeseenFleet
from pa_console.language.references.resolution import with_answers
from pa_console.language.references.scene import Move, PastMission, ReferenceScene, after
from pa_console.llm.backend import Answerer
from pa_console.llm.early_answers import EarlyAnswers
from pa_console.llm.local.engine import SessionEngine
from pa_console.llm.remote.servers import NO_SERVERS, Servers
from pa_console.llm.roles.clause_reader import ClauseReader
from pa_console.llm.roles.judge import Judge
from pa_console.llm.roles.planner import Planner
from pa_console.llm.roles.role_model import PROMPT_FORMATS, PromptFormat, RoleModel, format_in
from pa_console.mission.examine import Examination
from pa_console.mission.gate import CommandGate
from pa_console.mission.orders.standing import StandingOrders
from pa_console.policy.moments import Pursuits
from pa_console.policy.monitor import Monitor
from pa_console.policy.retriever import DEFAULT_METHOD, Retriever
from pa_console.policy.rule_variables import Sightings
from pa_console.policy.rulebook import Rulebook, with_core
from pa_console.schema.evaluation import Variant
from pa_console.schema.events.event import EventPayload, Noticed, ServerUse
from pa_console.schema.mission import Metrics, Mission, MissionStatus
from pa_console.schema.plan import Plan
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.session.log.journal import Journal

if TYPE_CHECKING:
    from pa_console.fleets.station_authority import StationAuthority

MOST_REMEMBERED = 20
"""The number of past missions that are kept, the latest ones, because orders may refer to them."""

Emit = Callable[[EventPayload], None]
"""A function that accepts an event; the station logs the event before any other part gets it."""


@dataclass
class PastOrders:
    """The operator's past missions, the latest last, and the object marked on the screen.

    The station keeps them for the session. A mission is added when it ends, unless its plans had no
    commands.
    """

    missions: list[PastMission] = field(default_factory=list[PastMission])
    pointer: str = ""
    """The asset, gate or track that the operator has marked; '' for none."""

    def scene(self, world: World, picture: Picture) -> ReferenceScene:
        """Return the assets, places and tracks that an order's words may refer to in `picture`."""
        return ReferenceScene(world, picture, tuple(self.missions), self.pointer)

    def remember(
        self, mission: Mission, moves: Iterable[Move], *, undid: bool, corrects: bool
    ) -> None:
        """Add a past mission if the operator gave it and it has any `moves`."""
        first: dict[str, Move] = {}
        for move in moves:
            before = first.setdefault(move.agent, move).before
            first[move.agent] = Move(move.agent, move.verb, move.target, before)
        if mission.source != "operator" or not first:
            return
        past = PastMission(mission.text, tuple(first.values()), undid)
        self.missions.append(after(self.missions, past, corrects=corrects))
        del self.missions[:-MOST_REMEMBERED]


def ordered_by(plan: Plan, picture: Picture) -> tuple[Move, ...]:
    """Return the moves that a plan orders, each from the agent's post or place in `picture`."""
    return tuple(
        Move(action.agent, action.verb, action.target or "", _place(picture, action.agent))
        for action in plan.actions
    )


def _place(picture: Picture, name: str) -> str:
    asset = picture.assets.get(name)
    return "" if asset is None else asset.post or asset.at or ""


@dataclass(frozen=True)
class Services:
    """The fleet, the rules and the models of a session; `variant` selects the active safeguards.

    All safeguards are active, except in the ablations of an evaluation.
    """

    fleet: Fleet
    rulebook: Rulebook
    retriever: Retriever
    engine: SessionEngine
    planner: Planner
    judge: Judge
    prompt_format: PromptFormat
    variant: Variant
    journal: Journal
    gate: CommandGate
    """The gate for every command to a device; only the gate calls `fleet.send`."""
    sightings: Sightings
    """The sightings of this session, which the station keeps."""
    pursuits: Pursuits
    """The pursuits of this session, which the missions' monitors keep."""
    standing: StandingOrders
    """The standing orders in force in this session, which the station keeps."""
    second_reader: Judge | ClauseReader | None = None
    """The model that reads an order again if the planner or the judge is unsure."""
    early: EarlyAnswers = field(default_factory=EarlyAnswers)
    """The local models' answers to a draft of an order, given before it was sent."""
    servers: Servers = NO_SERVERS
    """Models on servers, which are asked before the local models."""
    past: PastOrders = field(default_factory=PastOrders)
    """The orders given in this session, which the station keeps."""
    top_k: int = 3

    @classmethod
    def open(
        cls,
        fleet: Fleet,
        rulebook: Rulebook,
        engine: SessionEngine,
        variant: Variant | None = None,
        *,
        prompt_format: PromptFormat | None = None,
        retriever: Retriever | None = None,
        authority: "StationAuthority | None" = None,
        servers: Servers = NO_SERVERS,
    ) -> Self:
        """Return the services of a new session, with the core rules always in force.

        Planner and judge are two roles on `engine`. They use the prompt format of its model unless
        `prompt_format` is given. A `retriever` that has already indexed the rules saves that time.
        With an `authority`, approvals and commands are signed. Models on `servers` are asked first
        while they answer.
        """
        variant = variant or Variant()
        prompt_format = prompt_format or PROMPT_FORMATS[format_in(variant, engine.model.prompts)]
        if retriever is None:
            retriever = Retriever(rulebook.rules, variant.method or DEFAULT_METHOD)
        journal, standing, early = Journal(), StandingOrders(), EarlyAnswers()
        return cls(
            fleet=fleet,
            rulebook=with_core(rulebook),
            retriever=retriever,
            engine=engine,
            planner=Planner(early.due(engine), max_tokens=prompt_format.plan_tokens),
            judge=Judge(early.due(engine), max_tokens=prompt_format.verdict_tokens),
            prompt_format=prompt_format,
            variant=variant,
            journal=journal,
            gate=CommandGate(fleet, journal, authority, standing),
            sightings=Sightings(fleet.world),
            pursuits=Pursuits(),
            standing=standing,
            second_reader=_second_reader(engine, early.due),
            early=early,
            servers=servers,
        )

    @property
    def planners(self) -> tuple[RoleModel, ...]:
        """The models to ask for a plan, one after another, until one answers."""
        return self._on_server("planner")

    @property
    def judges(self) -> tuple[RoleModel, ...]:
        """The models to ask for a verdict, one after another, until one answers."""
        return self._on_server("judge")

    @property
    def server_reader(self) -> ClauseReader | None:
        """The second reader on a server; None while the server does not answer."""
        server = self.servers.by_use.get("second reader")
        return ClauseReader(server) if server is not None and server.usable else None

    def _on_server(self, use: ServerUse) -> tuple[RoleModel, ...]:
        """Return the model for `use` on a server that answers, if any, and then the local model."""
        own = RoleModel(self.planner, self.judge, self.prompt_format)
        server = self.servers.by_use.get(use)
        return (RoleModel.on(server), own) if server is not None and server.usable else (own,)

    @property
    def scene(self) -> ReferenceScene:
        """The assets, places and tracks that an order's words may refer to at present."""
        return self.past.scene(self.fleet.world, self.fleet.picture())

    def with_rules(self, rulebook: Rulebook) -> Self:
        """Return the services with other rules; sightings and decisions are kept."""
        retriever = self.retriever.over(rulebook.rules)
        return replace(self, rulebook=with_core(rulebook), retriever=retriever)

    def for_draft(self) -> Self:
        """Return the services for a draft, which is planned but never carried out.

        Only the local models are asked, and their answers are kept. The gate passes no command, and
        the draft does not affect later missions.
        """
        engine, ahead, prompt_format = self.engine, self.early.ahead, self.prompt_format
        gate = CommandGate(self.fleet, Journal())
        gate.stop_all()
        standing = StandingOrders(self.standing.time)
        standing.limits = self.standing.limits
        return replace(
            self,
            planner=Planner(ahead(engine), max_tokens=prompt_format.plan_tokens),
            judge=Judge(ahead(engine), max_tokens=prompt_format.verdict_tokens),
            second_reader=_second_reader(engine, ahead),
            servers=NO_SERVERS,
            journal=Journal(),
            gate=gate,
            standing=standing,
            past=PastOrders([*self.past.missions], self.past.pointer),
        )


def _second_reader(
    engine: SessionEngine, wrap: Callable[[Answerer], Answerer]
) -> Judge | ClauseReader | None:
    """Return the second reader: a trained judge for the compact format, otherwise a clause reader.

    `wrap` wraps the model that it asks.
    """
    second = engine.second_reader
    if second is None or second.model.prompts != "compact":
        return ClauseReader(wrap(second)) if second is not None else None
    return Judge(wrap(second), max_tokens=PROMPT_FORMATS["compact"].verdict_tokens)


@dataclass
class Stopwatch:
    """The total seconds of each stage, by its field name in Metrics."""

    seconds: dict[str, float] = field(default_factory=dict[str, float])
    started: float = field(default_factory=perf_counter)

    def add(self, stage: str, seconds: float) -> None:
        """Add `seconds` to `stage`."""
        self.seconds[stage] = self.seconds.get(stage, 0.0) + seconds

    @contextmanager
    def time(self, stage: str) -> Generator[None]:
        """Add the wall time of the block to `stage`."""
        begin = perf_counter()
        try:
            yield
        finally:
            self.add(stage, perf_counter() - begin)

    def metrics(self, attempts: int, plans: int = 0, halts: int = 0) -> Metrics:
        """Return all measurements so far; the end-to-end time ends now."""
        return Metrics.model_validate(
            {
                **self.seconds,
                "end_to_end_s": perf_counter() - self.started,
                "attempts": attempts,
                "plans": plans,
                "halts": halts,
            }
        )


@dataclass
class MissionContext:
    """The context of every step of one mission; `emit` accepts its events."""

    services: Services
    mission: Mission
    emit: Emit
    monitor: Monitor
    """The monitor that has followed the mission so far, which the steps only read."""
    stopwatch: Stopwatch = field(default_factory=Stopwatch)
    attempts: int = 0
    """The number of plans so far: the planner's answers and the operator's own plans."""
    described: tuple[str, tuple[str, ...]] = ("", ())
    """The order's words that describe an asset, and the assets that they may mean."""

    def as_described(self, text: str, reading: str) -> str:
        """Return `text` with its description replaced by a name, if `reading` names one choice."""
        words, choices = self.described
        named = [name for name in choices if re.search(rf"\b{re.escape(name)}\b", reading)]
        return with_answers(text, {words: named[0]}) if len(named) == 1 else text

    def turn_to_own(self, failed: RoleModel, error: str) -> None:
        """Emit a notice that the local model takes over from the `failed` model on a server."""
        text = f"{failed.where} {error}; {self.services.engine.model.name} on this machine answers"
        self.emit(Noticed(level="warning", subject="model server", text=text))

    def next_attempt(self) -> int:
        """Count one more plan and return its number, from 1."""
        self.attempts += 1
        return self.attempts


@dataclass(frozen=True)
class MissionResult:
    """The result of a mission, and its reason."""

    status: MissionStatus
    reason: str


class ForeseenContext:
    """The contexts of an order's steps, each from the rehearsals of the steps before it."""

    def __init__(self, context: MissionContext) -> None:
        self._context, self._services, self._monitor = context, context.services, context.monitor

    def begin(self, words: str) -> MissionContext:
        """Return the context for a step with these words."""
        mission = self._context.mission.model_copy(update={"text": words, "typed": ""})
        return replace(
            self._context, services=self._services, mission=mission, monitor=self._monitor
        )

    def end(self, step: MissionContext) -> None:
        """Take over the number of plans so far from a step's context."""
        self._context.attempts = step.attempts

    def went(self, examination: Examination, mission: Mission) -> bool:
        """Begin later steps at the end of this rehearsal; return False if no step can follow."""
        rehearsal, world = examination.rehearsal, self._services.fleet.world
        if examination.blocked or rehearsal is None:
            return False
        before, past = self._services.fleet.picture(), self._services.past
        past = PastOrders([*past.missions], past.pointer)
        as_operator = mission.model_copy(update={"source": "operator"})
        past.remember(
            as_operator, ordered_by(examination.plan, before), undid=False, corrects=False
        )
        fleet = ForeseenFleet(world, rehearsal.after)
        self._services = replace(self._services, fleet=fleet, past=past)
        self._monitor = self._monitor.copy()
        for moment in rehearsal.moments:
            self._monitor.observe(moment)
        return True
