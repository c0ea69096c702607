"""The situations whose prompts are held still, and everything that a model is given in them.

A mission is worked on twice. `told` asks the writers of prompts, grammars and canonical words one
by one; `heard` runs the mission at a station and takes down every request that its engine gets.
"""

import asyncio
import json
import random
from collections.abc import AsyncGenerator, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache
from itertools import islice
from typing import NamedTuple

from pa_console.evaluation.jobs import load_with_worlds
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.language.canonical.reading import asked_words, read_asked
from pa_console.language.clause_grammar import asked_pattern
from pa_console.language.orders.timed_orders import read_timed
from pa_console.llm.backend import GenerationEnd, Request
from pa_console.llm.roles.grammar import (
    PLANNED,
    CommandSlot,
    plan_grammar,
    reason_grammar,
    slot_grammar,
)
from pa_console.llm.roles.prompts import Prompt, paper_prompt
from pa_console.llm.roles.role_model import PROMPT_FORMATS, PromptFormat, PromptFormatName
from pa_console.mission.approval import standing_approver
from pa_console.mission.planning.choices import commands_serving
from pa_console.mission.planning.picture_text import digest_picture, select
from pa_console.policy.retriever import Retriever
from pa_console.resources import data_folder
from pa_console.schema.events.event import Event, MissionVerified, Role
from pa_console.schema.mission import ActionOutcome, Mission, Verification
from pa_console.schema.plan import Plan
from pa_console.session.state import SessionState
from pa_console.sim.worlds.world_generator import generate_world
from pa_console.station.assembly import Site, load_site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions
from pa_training.situations.situations import Situation, random_situation, settled
from pa_training.situations.worlds import random_world
from tests.golden.stored import read
from tests.scripted import ScriptedEngine, plan

PAPER: dict[str, tuple[str, tuple[tuple[str, str], ...]]] = {
    "P01": ("hold", (("Drone_T01", "hold"),)),
    "P02": ("1 drone to EastGate", (("Drone_T04", "move_to EastGate"),)),
    "P03": ("unknown vehicle at WestGate", (("Drone_T04", "observe WestGate"),)),
    "P04": (
        "unknown vehicle at WestGate; cover SouthGate",
        (("Drone_T04", "observe WestGate"), ("Ugv_T02", "move_to SouthGate")),
    ),
    "P05": (
        "unknown vehicle at NorthGate; unknown vehicle at EastGate",
        (("Drone_T02", "observe NorthGate"), ("Drone_T04", "observe EastGate")),
    ),
    "P06": (
        "unknown vehicle at NorthGate; unknown person at WestGate",
        (("Drone_T02", "observe NorthGate"), ("Drone_T01", "observe WestGate")),
    ),
    "P07": (
        "stand down WestGate",
        (("Ugv_T02", "return_to_base"), ("Robot_T01", "return_to_base")),
    ),
    "P08": ("cover SouthGate", (("Drone_T04", "move_to SouthGate"),)),
    "P09": ("all free to EastGate", (("Drone_T04", "move_to EastGate"),)),
    "P10": ("unknown at NorthGate", (("Drone_T02", "observe NorthGate"),)),
}
"""What each mission of the paper asks, in canonical words, and a plan for it."""

FIELD = 20
NOON = datetime(2026, 1, 1, 12, tzinfo=UTC)
GENERATED = 40
LARGE = {39: (24, 80, 5), 40: (12, 40, 6)}
"""Of the generated ones, those in a world too large to be told whole: gates, assets, seed."""
NO_TIME = datetime(2026, 1, 1, tzinfo=UTC)
REPAIR = ("WF-03: SouthGate would be left\nwithout cover", "CAP-01: no such asset")
ROLES: tuple[Role, ...] = ("planner", "judge", "outcome")


class Case(NamedTuple):
    """A mission in a situation with a plan for it, whose reason says what is `asked`."""

    name: str
    text: str
    situation: Situation
    asked: str
    plan: Plan
    canonical: tuple[str, ...] = ()
    """What the order asks, in canonical words with and without how its condition stands."""

    @property
    def mission(self) -> Mission:
        """The mission as the console has it."""
        return Mission(id="M", text=self.text, created=NO_TIME)


@cache
def shipped() -> Site:
    """Return the shipped world and rules."""
    return load_site("checkpoint", "checkpoint", deadline_s=60.0)


@cache
def retriever() -> Retriever:
    """Return what finds rules among the shipped ones."""
    return Retriever(shipped().rulebook.rules)


@cache
def cases() -> tuple[Case, ...]:
    """Return the ten of the paper, some of the field set and forty in generated situations."""
    return tuple(_cases())


def _cases() -> Iterator[Case]:
    world, folder = shipped().world, data_folder() / "worlds" / "checkpoint" / "missions"
    paper, _ = load_with_worlds(folder / "paper.yaml", world)
    for case in paper.missions:
        words, orders = PAPER[case.id]
        made = Plan.model_validate_json(plan(*orders, reason=f"asked: {words}"))
        yield Case(case.id, case.command, settled(world, 1, case.setup), f"asked: {words}", made)
    field, worlds = load_with_worlds(folder / "field.yaml", world)
    for case in field.missions[:: len(field.missions) // FIELD][:FIELD]:
        if read_timed(world, case.command, NOON) is not None:
            continue  # what it becomes depends on the time of the day
        there = settled(worlds[case.world] if case.world else world, 2, case.setup)
        yield _ordered(case.id, there)
    for number in range(1, GENERATED + 1):
        rng = random.Random(f"golden/{number}")
        large = LARGE.get(number)
        made = random_world(rng, "train") if large is None else generate_world(*large)
        yield _ordered(f"G{number:02}", random_situation(rng, made))


def _ordered(name: str, there: Situation) -> Case:
    """Return the order that is stored for a situation, with what it asks and a plan for it."""
    order = read("orders.json")[name]
    made = Plan.model_validate_json(json.dumps(order["plan"]))
    canonical = tuple(order["canonical"])
    return Case(name, order["text"], there, f"asked: {canonical[0]}", made, canonical)


def told(case: Case) -> Iterator[tuple[str, str]]:
    """Yield every prompt, grammar and canonical text for a mission by name."""
    world, picture, mission = case.situation.world, case.situation.picture, case.mission
    yield "mission", case.text
    for number, words in enumerate(case.canonical, start=1):
        yield f"canonical {number}", words
    yield "plan", case.plan.answer
    yield "asked words", asked_words(case.plan.reason)
    hits = retriever().retrieve(case.text, 3)
    rules = [shipped().rulebook.get(hit.rule_id) for hit in hits]
    yield "rules", " ".join(rule.id for rule in rules)
    selection = select(picture, world, mission, rules)
    digest = digest_picture(picture, world, selection)
    yield from _of("planner paper", paper_prompt(world, digest, rules, mission))
    shown = (None, None) if selection is None else (selection.assets, selection.frames)
    yield "clauses with facts", asked_pattern(world, digest, case.text)
    yield "clauses", asked_pattern(world, digest, case.text, facts=False)
    for name, prompt_format in PROMPT_FORMATS.items():
        first = prompt_format.planner(world, digest, rules, mission)
        again = prompt_format.planner(world, digest, rules, mission, REPAIR, case.plan.answer)
        yield from _of(f"planner {name}", first)
        yield from _of(f"planner {name} repair", again)
        for role in ROLES:
            yield from _of(f"ahead {name} {role}", prompt_format.ahead(role, world, digest))
            yield from _of(f"ahead {name} {role} blind", prompt_format.ahead(role, world, None))
            if prompt_format.typed is not None:
                begun = prompt_format.typed(
                    role, world, digest, rules, case.text[: len(case.text) // 2]
                )
                yield from _of(f"typed {name} {role}", begun)
        reasons = tuple(prompt_format.reason(world, digest, case.text, ""))
        known = tuple(prompt_format.reason(world, digest, case.text, case.asked))
        yield f"grammar {name} plan", plan_grammar(world, picture, *shown, (), reasons)
        yield f"grammar {name} plan known", plan_grammar(world, picture, *shown, (), known)
        if reasons:
            yield f"grammar {name} reason", reason_grammar(reasons)
        yield from _judged(case, name, prompt_format)
        for number, slots in enumerate(_slots(case), start=1):
            yield f"grammar {name} slots {number}", slot_grammar(slots, known or ("a",))


def _judged(case: Case, name: str, prompt_format: PromptFormat) -> Iterator[tuple[str, str]]:
    """Yield what the judge is asked of an outcome, and the grammars of how verdicts begin."""
    world, digest, passed = case.situation.world, case.situation.digest, "telemetry shows it"
    outcomes = tuple(
        ActionOutcome(
            agent=action.agent,
            command=action.command,
            outcome="unknown" if number else "pass",
            reason="nothing was heard" if number else passed,
        )
        for number, action in enumerate(case.plan.actions)
    )
    lost = tuple(world.gates)[-1:]
    found = Verification(
        outcome="fail", actions=outcomes, gates_lost=lost, reason="a gate was lost"
    )
    for how, verification in (
        ("fail", found),
        ("pass", Verification(outcome="pass", actions=outcomes[:1])),
    ):
        prompt = prompt_format.outcome(world, digest, case.mission, case.plan, verification)
        yield from _of(f"outcome {name} {how}", prompt)
    yield f"grammar {name} verdict", prompt_format.verdict(("WF-03", "ROE-05"))
    yield f"grammar {name} verdict of nothing", prompt_format.verdict(())
    if prompt_format.opening is not None:
        yield f"grammar {name} opening", prompt_format.opening(world, digest, case.text, "")
        yield (
            f"grammar {name} opening known",
            prompt_format.opening(world, digest, case.text, case.asked),
        )
    yield f"grammar {name} outcome opening", prompt_format.outcome_opening or ""


def _slots(case: Case) -> Iterator[Sequence[CommandSlot]]:
    reading = read_asked(case.asked)
    assert reading is not None
    yield from islice(commands_serving(reading, case.situation.world, case.situation.picture), 2)


def _of(name: str, prompt: Prompt) -> Iterator[tuple[str, str]]:
    yield f"{name} system", prompt.system
    yield f"{name} user", prompt.user


class _Listening(ScriptedEngine):
    """Answers as a trained or an untrained model would, and keeps every request in order."""

    def __init__(self, case: Case, prompts: PromptFormatName) -> None:
        super().__init__([case.plan.answer], others=[case.plan.answer])
        self.model = replace(self.model, prompts=prompts)
        self._opening = f'{{"feedback": "{case.asked}{PLANNED}'
        self.heard: list[Request] = []

    async def generate(self, request: Request) -> AsyncGenerator[str | GenerationEnd]:
        self.heard.append(request)
        if request.role != "planner" and self.model.prompts == "compact":
            said = f'{self._opening}done", "violated": [], "verdict": "Success"}}'
            begins = "FEEDBACK" not in request.grammar
            self._answers["judge"] = [self._opening if begins else said]
        async for item in super().generate(request):
            yield item


@dataclass(frozen=True)
class Heard:
    """A request as it is stored: everything that the engine was given."""

    name: str
    request: Request

    def texts(self) -> Iterator[tuple[str, str]]:
        """Yield the parts of the request by name."""
        asked = self.request
        yield f"{self.name} system", asked.system
        yield f"{self.name} user", asked.user
        yield f"{self.name} grammar", asked.grammar
        rest = (asked.max_tokens, asked.count, asked.hint, asked.begun, asked.within, asked.stop)
        yield f"{self.name} rest", repr((asked.role, asked.deadline_s, *rest))


def heard(case: Case, prompts: PromptFormatName, *, carried_out: bool) -> Iterator[tuple[str, str]]:
    """Yield what an engine is asked for a mission at a station, and how the mission ends.

    Plans are approved where they are to be `carried_out`, and rejected otherwise.
    """
    engine, there = _Listening(case, prompts), case.situation
    site = replace(shipped(), world=there.world)
    fleet = SimulatedFleet(there.fork())
    station = open_station(site, engine.engine(), SteppedClock(), fleet=fleet)
    approver = standing_approver("auto" if carried_out else "never", "the outcome is wanted")
    verified: list[int] = []

    def note(event: Event, _: SessionState) -> None:
        if isinstance(event.data, MissionVerified):
            verified.append(len(engine.heard))

    traces = asyncio.run(run_missions(station, [case.text], approver, note))
    for number, request in enumerate(_plan_by_plan(engine.heard, verified), start=1):
        yield from Heard(f"station {prompts} {number} {request.role}", request).texts()
    ended = [f"{trace.status}: {trace.reason}" for trace in traces]
    yield f"station {prompts} ended", "\n".join(ended)


def _plan_by_plan(heard: Sequence[Request], verified: Sequence[int]) -> list[Request]:
    """Return the requests of a mission, what is asked of each outcome where it was `verified`.

    It is asked after the mission. The numbers say how many requests came before each outcome.
    """
    result = [request for request in heard if request.role != "outcome"]
    late: list[list[Request]] = []
    for request in heard:
        if request.role == "outcome" and not request.begun:
            late.append([request])
        elif request.role == "outcome":
            late[-1].append(request)
    for place, asked in reversed(list(zip(verified, late, strict=True))):
        result[place:place] = asked
    return result


def everything(case: Case) -> dict[str, str]:
    """Return all texts for a mission by name.

    Those of the paper are carried out in every format; of the others, the field's and every fifth
    of the generated ones are worked on at a station until a plan is put forward.
    """
    texts = dict(told(case))
    of_paper = case.name in PAPER
    at_station = not case.name.startswith("G") or int(case.name[1:]) % 5 == 0
    for prompts in PROMPT_FORMATS if of_paper else ("compact",) * at_station:
        texts.update(heard(case, prompts, carried_out=of_paper))
    return texts
