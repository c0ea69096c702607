"""The recorder of a run's truth since the command, and its strict score (paper, Section V).

The success conditions of missions are CEL expressions about `run`. Their names are checked.
"""

import re
from collections.abc import Collection, Iterator, Sequence, Set
from types import UnionType
from typing import Any, Literal, get_args, get_origin

import cel
from pydantic import BaseModel

from pa_console.evaluation.oracle import find_breaches
from pa_console.evaluation.run_facts import (
    STAYING,
    IssuedCommand,
    RuleBreach,
    RunFacts,
    RunRecording,
    Sample,
    gather,
)
from pa_console.schema.base import StrictModel
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.events import event as ev
from pa_console.schema.mission import MissionStatus
from pa_console.schema.world import World
from pa_console.sim.checkpoint import Checkpoint

_TEXT = re.compile(r"'(?:[^'\\]|\\.)*'|\"(?:[^\"\\]|\\.)*\"")
_FIELD = re.compile(r"\.\s*([A-Za-z_]\w*)(?!\w)\s*(\()?")
_KEY = re.compile(r"(?<=[\w)\]])(?<!\bin)\[\s*(?:'([^'\\]*)'|\"([^\"\\]*)\")\s*\]")
_SAID = re.compile(
    r"\.\s*(gate|kind|verb|task|status|identity|intent)\s*[!=]=\s*(?:'([^'\\]*)'|\"([^\"\\]*)\")"
)
_IN = re.compile(
    r"(?:'([^'\\]*)'|\"([^\"\\]*)\")\s+in\s+run\s*\.\s*(moved|reports|gates|coverage|visited)\b(?!\s*\[)"
)
_FUNCTIONS = frozenset(
    ("contains", "double", "endsWith", "has", "int", "matches", "size", "startsWith", "string")
)
_BOUND = re.compile(r"\.\s*(?:all|exists|exists_one|filter|map)\s*\(\s*(\w+)\s*,")
_RUN = re.compile(r"\brun\b(?:\s*\.\s*([A-Za-z_]\w*))?")

FROM_ORDERS = frozenset(
    (
        "command", "status", "refused", "actions", "reports", "moved", "broken", "start",
        "grace_s", "standoff_m", "gates", "base",
    )
)  # fmt: skip
"""The fields of `run` that can no longer change once all orders are answered.

This applies only if no order has sent an asset anywhere.
"""

SETTLE_S = 2.0
"""The simulated time between the set-up and the command, in seconds."""


def wrong_name(source: str, world: World | None) -> str:
    """Return the first unknown name in `source`, with the known names; '' if there is none.

    The names of fields of `run` and of its parts must exist. So must the gates and assets that are
    keys in brackets, and the values with which a gate, a kind, a verb and so on is compared. Agents
    and frames of actions are not checked, because an order can name an asset or a frame that does
    not exist. Without `world`, only the fields of `run` itself are checked.
    """
    bare = _TEXT.sub("''", source)
    for match in re.finditer(r"\brun\s*\.\s*([A-Za-z_]\w*)", bare):
        if match[1] not in RunFacts.model_fields:
            return f"run has no field {match[1]!r}; known: {', '.join(RunFacts.model_fields)}"
    if world is None:
        return ""
    names = _FIELDS | set(world.gates) | set(world.assets)
    for field, call in _FIELD.findall(bare):
        if not call and field not in names:
            return f"nothing in a run has a field {field!r}; known: {', '.join(sorted(_FIELDS))}"
    for word, choices in _values(source, world):
        if word not in choices:
            return f"there is no {word!r} here; known: {', '.join(sorted(choices))}"
    return ""


def _values(source: str, world: World) -> Iterator[tuple[str, Set[str]]]:
    """Yield each text in `source` that must be one of a known set of texts, with that set."""
    gates, assets = set(world.gates), set(world.assets)
    for single, double in _KEY.findall(source):
        yield single or double, gates | assets
    for single, double, where in _IN.findall(source):
        yield single or double, gates if where in {"gates", "coverage"} else assets
    for field, single, double in _SAID.findall(source):
        yield single or double, _WORDS.get(field, gates)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the Pydantic models in the type of a field, including the models of their fields."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        for field in annotation.model_fields.values():
            yield from _models(field.annotation)
    for part in get_args(annotation):
        yield from _models(part)


def _words(annotation: Any) -> set[str]:
    """Return the texts that a field allows; an empty set if it allows any text."""
    if get_origin(annotation) is Literal:
        return set(get_args(annotation))
    if isinstance(annotation, UnionType):
        return {word for part in get_args(annotation) for word in _words(part)}
    return set()


def _vocabulary() -> dict[str, set[str]]:
    """Return the texts that the fields of a run allow, by the name of the field."""
    words: dict[str, set[str]] = {"kind": {"vehicle", "person"}}
    for model in _models(RunFacts):
        for name, field in model.model_fields.items():
            if choices := _words(field.annotation):
                words.setdefault(name, set()).update(choices)
    return words


_WORDS = _vocabulary()
_FIELDS = frozenset(name for model in _models(RunFacts) for name in model.model_fields)


def compile_condition(source: str, world: World | None = None) -> cel.Program:
    """Return a compiled success condition.

    Raises ValueError if `source` is not valid CEL or has a name that no run has. If `world` is
    given, the gates and assets that are used as keys must exist in it.
    """
    try:
        program = cel.compile(source)
    except ValueError as error:
        raise ValueError(f"not valid CEL: {_syntax_problem(error)}") from error
    references = program.references()
    unknown = sorted(set(references["variables"]) - set(_BOUND.findall(source)) - {"run"})
    if unknown:
        raise ValueError(f"unknown name {unknown[0]!r}; a condition may only refer to 'run'")
    functions = {name for name in references["functions"] if name.isidentifier()}
    if missing := sorted(functions - _FUNCTIONS):
        raise ValueError(f"unknown function {missing[0]!r}; known: {', '.join(sorted(_FUNCTIONS))}")
    if problem := wrong_name(source, world):
        raise ValueError(problem)
    return program


def asked_fields(source: str) -> frozenset[str]:
    """Return the fields of `run` that a condition uses; '' stands for `run` as a whole."""
    return frozenset(match[1] or "" for match in _RUN.finditer(_TEXT.sub("''", source)))


def failed_conditions(sources: Sequence[str], facts: RunFacts) -> tuple[str, ...]:
    """Return the conditions that do not hold; if one cannot be evaluated, add the error to it.

    Raises ValueError if a condition does not compile.
    """
    context = cel.Context(variables={"run": facts.document()})
    programs = [(source, compile_condition(source)) for source in sources]
    failed: list[str] = []
    for source, program in programs:
        try:
            value: Any = program.execute(context)
        except Exception as error:  # the CEL runtime raises many kinds; all mean "does not hold"
            failed.append(f"{source} (error: {type(error).__name__}: {error})")
            continue
        if not isinstance(value, bool):
            failed.append(f"{source} (error: the result is {value!r}, not true or false)")
        elif not value:
            failed.append(source)
    return tuple(failed)


def _syntax_problem(error: ValueError) -> str:
    """Return the place and the text of a syntax error, without the expression."""
    place = re.search(r"<input>:(\d+):(\d+): (.*)", str(error))
    if place is None:
        return str(error).splitlines()[0]
    return f"line {place[1]}, column {place[2]}: {place[3].split(' expecting ')[0]}"


def is_decided(case: MissionCase, recording: RunRecording) -> bool:
    """Return whether the score of a finished run of `case` can no longer change.

    It cannot change if all orders were holds or reports and have been answered, and if the
    conditions use only fields in FROM_ORDERS. Then no order can move an asset, and only orders can
    break a rule (see oracle.py).
    """
    answered = all(o.verb in STAYING and (o.done or o.rejected) for o in recording.orders)
    return answered and all(asked_fields(source) <= FROM_ORDERS for source in case.success)


class RunRecorder:
    """The recorder of a run's truth, from the events of a session or from calls without a station.

    The recorder must be created at the time of the command, because it records the start of the
    run at once.
    """

    def __init__(self, sim: Checkpoint, command: str) -> None:
        self._sim, self._start_tick, self._start_s = sim, sim.tick, sim.time_s
        self._orders: dict[str, IssuedCommand] = {}
        self.recording = RunRecording(sim.world, command)
        self.sample()

    def see(self, event: ev.Event) -> None:
        """Process one event of the session; the truth is sampled at each telemetry event."""
        match event.data:
            case ev.TelemetryReceived():
                self.sample()
            case ev.CommandSent(command=command) if event.tick >= self._start_tick:
                self._take(command, event.tick * self._sim.world.dt_s)
            case ev.CommandReplied(reply=reply):
                self.replied(reply)
            case _:
                pass

    def sample(self) -> None:
        """Record the current truth, unless there is already a sample at this time."""
        time_s = round(self._sim.time_s - self._start_s, 6)
        if self.recording.samples and time_s <= self.recording.final.time_s:
            return
        self.recording.samples.append(_sample(self._sim, time_s))

    def sent(self, command: DeviceCommand) -> None:
        """Record that `command` is sent now."""
        self._take(command, self._sim.time_s)

    def replied(self, reply: CommandReply) -> None:
        """Record a device's answer; answers to orders from before the run are ignored."""
        order = self._orders.get(reply.command_id)
        if order is not None:
            order.done = order.done or reply.status == "done"
            order.rejected = order.rejected or reply.status == "refused"

    def finish(self, status: MissionStatus) -> RunFacts:
        """Return the run's facts with the mission's `status`; `broken` is still empty."""
        self.sample()
        return gather(self.recording, status)

    def _take(self, command: DeviceCommand, time_s: float) -> None:
        """Record an order when it is first sent, and not when it is sent again."""
        self.sample()
        if command.command_id in self._orders:
            return
        order = IssuedCommand(
            command_id=command.command_id,
            agent=command.agent,
            verb=command.verb,
            frame=command.target or "",
            sent_s=max(0.0, round(time_s - self._start_s, 6)),
        )
        self._orders[command.command_id] = order
        self.recording.orders.append(order)


def _sample(sim: Checkpoint, time_s: float) -> Sample:
    truth = sim.truth()
    return Sample(
        time_s=time_s,
        assets=truth.assets,
        contacts={contact.id: contact for contact in sim.true_contacts()},
        cover={gate: cover.by for gate, cover in truth.gates.items()},
    )


class Score(StrictModel):
    """The strict success of a run (paper, Section V-B), with failed conditions and breaches."""

    strict: bool
    failed: tuple[str, ...] = ()
    broken: tuple[RuleBreach, ...] = ()


def score(case: MissionCase, facts: RunFacts, breaches: Sequence[RuleBreach]) -> Score:
    """Return the score of a run of `case`; its conditions see the broken rules as `run.broken`."""
    ids = tuple(sorted({breach.rule_id for breach in breaches}))
    failed = failed_conditions(case.success, facts.model_copy(update={"broken": ids}))
    return Score(strict=not failed and not breaches, failed=failed, broken=tuple(breaches))


def score_run(
    case: MissionCase, recorder: RunRecorder, status: MissionStatus, enforced: Collection[str]
) -> Score:
    """Return the score of the finished run in `recorder`; `enforced` has the ids of the rules."""
    facts = recorder.finish(status)
    return score(case, facts, find_breaches(recorder.recording, enforced))


def idle_run(case: MissionCase, world: World, seed: int, enforced: Collection[str]) -> Score:
    """Return the score of `case` without orders; raises ValueError if its set-up is impossible."""
    sim = begin(case, world, seed)
    recorder = RunRecorder(sim, case.command)
    if not is_decided(case, recorder.recording):
        watch(sim, recorder, case.watch_s)
    return score_run(case, recorder, "refused", enforced)


def begin(case: MissionCase, world: World, seed: int) -> Checkpoint:
    """Return a new checkpoint with the set-up of `case`, at the time of the command."""
    sim = Checkpoint(world, seed)
    for incident in case.setup:
        sim.inject(incident)
    for _ in range(round(SETTLE_S / world.dt_s)):
        sim.step()
    return sim


def watch(sim: Checkpoint, recorder: RunRecorder, seconds: float) -> None:
    """Simulate `seconds`, and record the replies and the truth."""
    for _ in range(round(max(0.0, seconds) / sim.world.dt_s)):
        for reply in sim.step():
            recorder.replied(reply)
        look(sim, recorder)


def look(sim: Checkpoint, recorder: RunRecorder) -> None:
    """Record the truth if a telemetry period ends at this tick."""
    if sim.tick % max(1, round(sim.world.telemetry_period_s / sim.world.dt_s)) == 0:
        recorder.sample()
