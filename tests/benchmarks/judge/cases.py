"""Finds in an evaluation the plans that were executed, with what their judge was given then."""

import hashlib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pa_console.evaluation.run_record import RunRecord
from pa_console.mission.judge import PlanCase
from pa_console.mission.verify import OutcomeCase
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import find_data
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Verdict
from pa_console.schema.mission import Mission
from pa_console.schema.telemetry import Picture
from pa_console.schema.world import World
from pa_console.session.log.chain import read_log
from pa_console.session.mission_trace import MissionTrace
from pa_console.session.state import SessionState
from pa_console.sim.worlds.world_file import open_world


@dataclass(frozen=True)
class JudgedCase:
    """One run whose only plan was executed; `after` is None when nothing was verified.

    `own` says that the planner was the model `planner_sha256` with the adapters of these hashes.
    """

    record: RunRecord
    world: World
    rulebook: Rulebook
    plan: PlanCase
    after: OutcomeCase | None
    logged: tuple[Verdict | None, Verdict | None]
    """The verdicts on plan and outcome that the evaluation's own judge gave."""
    planner_sha256: str
    adapters: frozenset[str]
    changed: bool
    """Whether the world's or the rules' file is another one now."""


class LeftOutError(ValueError):
    """Why a run says nothing of a judge."""


def choose_runs(
    records: Iterable[RunRecord],
    variants: Sequence[str] = (),
    planners: Sequence[str] = (),
    every: int = 1,
) -> tuple[list[RunRecord], Counter[str]]:
    """Return the runs in which one plan was executed, and how many others there are, by reason.

    Empty `variants` or `planners` take all of them; of the runs of each category only every n-th
    is returned. Raises ValueError, with the known names, for a variant or planner that no run has.
    """
    known = list(records)
    _refuse_unknown("variant", variants, [record.variant for record in known])
    _refuse_unknown("planner", planners, [record.model for record in known])
    kept: list[RunRecord] = []
    left_out: Counter[str] = Counter()
    numbers: Counter[str] = Counter()
    for record in known:
        if variants and record.variant not in variants:
            left_out["another variant"] += 1
        elif planners and record.model not in planners:
            left_out["another planner"] += 1
        elif record.metrics.plans != 1:
            none = record.metrics.plans == 0
            left_out["no plan was executed" if none else "several plans were executed"] += 1
        elif not record.log:
            left_out["its log was not kept"] += 1
        else:
            if numbers[record.category] % every == 0:
                kept.append(record)
            else:
                left_out[f"not one in {every} of its category"] += 1
            numbers[record.category] += 1
    return kept, left_out


def _refuse_unknown(what: str, wanted: Sequence[str], known: Sequence[str]) -> None:
    for name in wanted:
        if name not in known:
            names = ", ".join(dict.fromkeys(known)) or "none"
            raise ValueError(f"no run has the {what} {name!r}; there is: {names}")


class CaseReader:
    """Reads the logs of the evaluation in `folder`; worlds and rules are loaded once each."""

    def __init__(self, folder: Path, world: str | None = None, rules: str | None = None) -> None:
        """`world` and `rules` stand in for those that the logs name.

        Raises DocumentError when a generated world of the evaluation or `rules` cannot be read.
        """
        self._folder, self._world, self._rules = folder, world, rules
        self._generated = {_sha256(path): path for path in folder.glob("worlds/*/world.yaml")}
        self._worlds: dict[str, tuple[World, str]] = {}
        self._books: dict[str, Rulebook] = {}

    def read(self, record: RunRecord) -> JudgedCase:
        """Return what the log of `record` holds.

        Raises LeftOutError when it holds no whole case, LogError for a damaged log, DocumentError
        or ValueError when its world or rules are not here.
        """
        path = self._folder / record.log
        if not path.is_file():
            raise LeftOutError("its log is not there")
        reading = _Reading()
        for event in read_log(path):
            reading.see(event)
        started = reading.state.started
        if started is None or reading.asked is None:
            raise LeftOutError("its log shows no decision on a plan")
        if len(reading.executed) != 1:
            raise LeftOutError("its log shows another number of executed plans")
        world, world_sha256 = self._world_of(started)
        rulebook = self._rules_of(started)
        case = reading.asked
        known = {rule.id for rule in rulebook.rules}
        quoted = {hit.rule_id for hit in case.hits} | {f.rule_id for f in case.findings if f.broken}
        if not quoted <= known:
            raise LeftOutError("it quotes a rule that is not in force any more")
        hashes = (started.world_sha256, started.rules_sha256)
        return JudgedCase(
            record,
            world,
            rulebook,
            case,
            reading.outcome(),
            reading.verdicts(),
            started.model_sha256,
            frozenset(started.adapters.values()),
            hashes != (world_sha256, rulebook.sha256),
        )

    def _world_of(self, started: ev.SessionStarted) -> tuple[World, str]:
        """Return the world of a session and the hash of its file."""
        name = self._world or started.world
        path = self._generated.get(started.world_sha256)
        key = str(path or name)
        if key not in self._worlds:
            if path is None and not find_data("worlds", name, "world.yaml").is_file():
                raise ValueError(
                    f"the world {name!r} of {self._folder} is not installed here; give its file "
                    "with --world"
                )
            world, found = open_world(key)
            self._worlds[key] = world, _sha256(found)
        return self._worlds[key]

    def _rules_of(self, started: ev.SessionStarted) -> Rulebook:
        name = self._rules or started.rules
        if name not in self._books:
            path = find_data("rules", name, "rules.yaml")
            if not path.is_file():
                raise ValueError(
                    f"the rules {name!r} of {self._folder} are not installed here; give their "
                    "file with --rules"
                )
            self._books[name] = load_rules(path)
        return self._books[name]


@dataclass
class _Reading:
    """Follows a log's first mission; `asked` is what the judge was given of the approved plan."""

    state: SessionState = field(default_factory=SessionState)
    mission: str | None = None
    task: Mission | None = None
    asked: PlanCase | None = None
    executed: set[int] = field(default_factory=set[int])
    after: Picture | None = None

    def see(self, event: ev.Event) -> None:
        """Take in the next event."""
        self.state.apply(event)
        if self.mission is None and isinstance(event.data, ev.MissionReceived):
            self.mission = event.data.mission.id
        elif self.mission is not None and event.mission == self.mission:
            self._see(event.data, self.state.missions[self.mission])

    def _see(self, data: ev.EventPayload, trace: MissionTrace) -> None:
        match data:
            case ev.RulesRetrieved():
                self.task = _task(trace)
                self._keep_outcome(trace)
            case ev.DecisionMade(accepted=True, decision=decision, attempt=number):
                if decision.kind == "approve":
                    self.asked = _case(trace, self.task or trace.mission, number)
            case ev.CommandSent():
                self.executed.add(trace.executing)
            case ev.OutcomeJudged() | ev.MissionFinished():
                self._keep_outcome(trace)
            case _:
                pass

    def _keep_outcome(self, trace: MissionTrace) -> None:
        """Keep the picture that the first outcome is judged in: the mission goes on, or ends."""
        if self.after is None and (trace.verified or trace.status is not None):
            self.after = self.state.picture

    def outcome(self) -> OutcomeCase | None:
        """Return what the judge was given after the plan, None when nothing was verified."""
        trace = self.state.missions[self.mission or ""]
        if self.asked is None or self.after is None or trace.verification is None:
            return None
        asked = self.asked
        return OutcomeCase(
            asked.task,
            asked.rehearsal.before,
            self.after,
            asked.digest.selection,
            asked.plan,
            trace.verification,
        )

    def verdicts(self) -> tuple[Verdict | None, Verdict | None]:
        """Return the verdicts on the executed plan and on its outcome that the log holds."""
        trace = self.state.missions[self.mission or ""]
        return trace.attempt(trace.executing).verdict, trace.outcome_verdict


def _task(trace: MissionTrace) -> Mission:
    """Return what the next plan is for: the phase of a workflow, else the mission itself."""
    for track, move in trace.standings.items():
        if move.command:
            return trace.mission.model_copy(update={"text": move.command, "subject": track})
    return trace.mission


def _case(trace: MissionTrace, task: Mission, number: int) -> PlanCase:
    """Return what the judge was given of attempt `number`; raises LeftOutError if that is gone.

    The picture is that of the last question for a plan, as the judge's is.
    """
    attempt = trace.find(number)
    if attempt is None or attempt.plan is None or trace.digest is None:
        raise LeftOutError("its log does not show the approved plan")
    if attempt.rehearsal is None:
        raise LeftOutError("its plan was not rehearsed")
    return PlanCase(
        task, trace.hits, trace.digest, attempt.plan, attempt.findings, attempt.rehearsal
    )


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
