"""The runner of an evaluation, which makes runs in one or more lanes and stores their records."""

import asyncio
from collections.abc import AsyncGenerator, Callable, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path

from pa_console.evaluation.jobs import Job
from pa_console.evaluation.memo_engine import MemoEngine
from pa_console.evaluation.oracle import find_breaches
from pa_console.evaluation.run_record import LOGS, EvaluationFolder, Opinion, RunRecord
from pa_console.evaluation.score import RunRecorder, Score, idle_run, is_decided, score
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.mission.approval import Approver, standing_approver
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.evaluation import MissionCase
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Usage
from pa_console.schema.mission import Decision, Metrics
from pa_console.session.log.writer import LogWriter
from pa_console.session.mission_trace import Attempt, MissionTrace
from pa_console.session.state import SessionState
from pa_console.sim.checkpoint import Checkpoint
from pa_console.station.assembly import open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions

OVERRIDE = "evaluation: the truth of every judged plan is wanted"
CHUNK = 12
"""The number of missions that a lane runs in one variant before it runs them in the next variant.

In this way, the model seldom has to read the fixed part of a prompt again, and equal prompts of
different variants follow each other closely.
"""

IdleScore = Callable[[], Score]
"""A function that returns the score of a mission without orders, which may have to be simulated."""

EngineFor = Callable[[str, int], MemoEngine]
"""A function that returns an engine, given the name of a model and a lane (0, 1, ...)."""


async def make_run(job: Job, engine: MemoEngine, idle: IdleScore, log: Path | None) -> RunRecord:
    """Run `job`, and return its record with the score.

    Plans are executed if the checks allow it. A judge's objection is recorded and overridden.
    `idle` is called only if the judge objected to the first plan. The latencies are those of a
    typed order, because the model reads the picture before the command arrives, unless answers are
    reused. Raises ValueError if the set-up is not possible, and OSError if the log cannot be
    written.
    """
    sim = Checkpoint(job.site.world, job.seed)
    station = open_station(
        job.site,
        engine,
        SteppedClock(),
        fleet=SimulatedFleet(sim),
        keep_engine=True,
        variant=job.variant,
        read_unasked=False,
    )
    watch = _RunNotes(sim, job.case.command)
    reused = engine.reused
    writer = LogWriter(log, station.session) if log is not None else None
    try:

        def sink(event: ev.Event, _: SessionState) -> None:
            watch.see(event)
            if writer is not None:
                writer.append(event)

        traces = await run_missions(
            station,
            job.case.turns,
            _answering(job.case, standing_approver("auto", OVERRIDE, job.variant.reading)),
            sink,
            job.case.setup,
            duration_s=job.case.watch_s,
            decided=lambda: watch.decides(job.case),
            read_ahead=engine.reads_ahead,
        )
    finally:
        if writer is not None:
            writer.close()
    trace = traces[-1] if len(traces) == len(job.case.turns) else None
    if trace is None or trace.status is None or watch.recorder is None:
        raise ValueError(f"{job.run}: the mission did not end: {watch.ending or 'no reason given'}")
    facts = watch.recorder.finish(trace.status)
    breaches = find_breaches(watch.recorder.recording, enforced_rules(job.site.rulebook))
    scored = score(job.case, facts, breaches)
    return _record(job, trace, scored, idle, watch, facts.refused).model_copy(
        update={
            "session": station.session,
            "log": f"{log.parent.name}/{log.name}" if log is not None else "",
            "reused": engine.reused - reused,
            "read_ahead": engine.reads_ahead,
        }
    )


def _answering(case: MissionCase, approver: Approver) -> Approver:
    """Return an approver that gives the answers of `case` in turn, and otherwise asks `approver`.

    An answer is given to each question about a command that was not understood.
    """
    answers = list(case.answers)

    def decide(request: ev.ApprovalRequested) -> Decision:
        if request.state == "not_understood" and answers:
            return Decision(kind="answer", by="evaluation", asked=answers.pop(0))
        return approver(request)

    return decide


def enforced_rules(rulebook: Rulebook) -> frozenset[str]:
    """Return the ids of the Critical and High rules in `rulebook`."""
    return frozenset(rule.id for rule in rulebook.rules if rule.priority != "medium")


class _RunNotes:
    """The facts from a run's events that the mission's trace does not have."""

    def __init__(self, sim: Checkpoint, command: str) -> None:
        self._sim, self._command = sim, command
        self.recorder: RunRecorder | None = None
        self.approved: list[int] = []
        self.offered: int | None = None
        self.ending = ""

    def decides(self, case: MissionCase) -> bool:
        """Return whether no later event can change the score."""
        return self.recorder is not None and is_decided(case, self.recorder.recording)

    def see(self, event: ev.Event) -> None:
        if self.recorder is not None:
            self.recorder.see(event)
        match event.data:
            case ev.MissionReceived() if self.recorder is None:
                self.recorder = RunRecorder(self._sim, self._command)
            case ev.ApprovalRequested(readings=readings) if self.offered is None:
                self.offered = len(readings)
            case ev.DecisionMade(accepted=True, attempt=attempt, decision=decision):
                if decision.kind == "approve":
                    self.approved.append(attempt)
            case ev.SessionEnded(reason=reason):
                self.ending = reason
            case _:
                pass


def _record(  # noqa: PLR0917
    job: Job, trace: MissionTrace, scored: Score, idle: IdleScore, watch: _RunNotes, refused: bool
) -> RunRecord:
    case = job.case
    approved = [trace.attempt(number) for number in watch.approved]
    opinions: list[Opinion] = [a.verdict.verdict for a in approved if a.verdict is not None]
    first, later = opinions[:1], opinions[1:]
    outcome = trace.outcome_verdict.verdict if trace.outcome_verdict is not None else None
    last = (approved or trace.attempts)[-1:] or [Attempt(0)]
    executed = any(item.round >= 0 for item in trace.commands.values())
    return RunRecord(
        run=job.run,
        model=job.model,
        variant=job.variant.name,
        mission_set=job.mission_set,
        mission=case.id,
        seed=job.seed,
        world=job.site.world.name,
        category=case.category,
        tags=case.tags,
        expect=case.expect,
        command=case.command,
        status=trace.status or "failed",
        reason=trace.reason,
        refused=refused,
        strict=scored.strict,
        obeyed=_obeyed(scored, idle, first, later),
        hybrid=_hybrid(job, outcome, executed),
        failed=scored.failed,
        broken=scored.broken,
        judge_plan=_overall(opinions),
        judge_outcome=outcome,
        verification=trace.verification.outcome if trace.verification is not None else None,
        confidence=last[0].sure,
        offered=watch.offered or 0,
        valid_json=bool(trace.attempts) and trace.attempts[0].plan is not None,
        first_sound=bool(trace.attempts) and _sound(trace.attempts[0]),
        attempts=len(trace.attempts),
        plan=tuple(f"{a.agent} {a.command}" for a in last[0].plan.actions) if last[0].plan else (),
        metrics=_times(trace),
        planner=trace.attempts[0].usage if trace.attempts else Usage(),
        judge=approved[0].judge_usage if approved else Usage(),
    )


def _hybrid(job: Job, outcome: Opinion | None, executed: bool) -> bool | None:
    """Return whether the judge's verdict on the outcome is Success; None without a judge.

    If nothing was executed, return whether the mission allows that.
    """
    if not job.variant.judging:
        return None
    return outcome == "Success" if executed else job.case.expect in ("refuse", "either")


def _overall(opinions: list[Opinion]) -> Opinion | None:
    """Return Failure if the judge objected to any executed plan, else Success.

    Returns None if there are no verdicts.
    """
    if not opinions:
        return None
    return "Failure" if "Failure" in opinions else "Success"


def _obeyed(scored: Score, idle: IdleScore, first: list[Opinion], later: list[Opinion]) -> bool:
    """Return whether the run would be a strict success if the operator obeyed the judge.

    After an objection to the first plan, nothing is ordered. After an objection to a later plan,
    the mission remains unfinished.
    """
    if first == ["Failure"]:
        return idle().strict
    return scored.strict and "Failure" not in later


def _sound(attempt: Attempt) -> bool:
    return attempt.plan is not None and not any(f.blocking for f in attempt.findings)


def _times(trace: MissionTrace) -> Metrics:
    """Return the metrics, with the original times of reused answers.

    A reused answer takes no time, so the time that it took originally is used instead.
    """
    metrics = trace.metrics or Metrics()
    measured = {
        "planning_s": sum(a.usage.seconds for a in trace.attempts),
        "judging_s": sum(a.judge_usage.seconds for a in trace.attempts),
    }
    if trace.attempts:
        measured["first_token_s"] = trace.attempts[0].usage.first_token_s
    recorded = metrics.model_dump()
    changes = {stage: max(recorded[stage], seconds) for stage, seconds in measured.items()}
    added = sum(changes[stage] - recorded[stage] for stage in ("planning_s", "judging_s"))
    return metrics.model_copy(update={**changes, "end_to_end_s": metrics.end_to_end_s + added})


class Runner:
    """The runner of all jobs that have no run in `results`."""

    def __init__(
        self,
        results: EvaluationFolder,
        engine_for: EngineFor,
        *,
        lanes: int = 1,
        keep_logs: bool = True,
    ) -> None:
        self._results, self._engine_for = results, engine_for
        self._lanes, self._keep_logs = lanes, keep_logs
        self._idle: dict[tuple[str, str, int], Score] = {}

    async def run(self, jobs: Sequence[Job]) -> AsyncGenerator[RunRecord]:
        """Yield each run once it is stored; the models are run one after the other.

        If a run fails, its error is raised and the other lanes are cancelled.
        """
        done = self._results.done
        missing = [job for job in jobs if job.run not in done]
        for model, of_model in groupby(missing, key=lambda job: job.model):
            async for record in self._model(model, list(of_model)):
                yield record

    async def _model(self, model: str, jobs: list[Job]) -> AsyncGenerator[RunRecord]:
        """Yield the runs of one model; each lane loads the model's weights once."""
        waiting = chunks(jobs)
        made: asyncio.Queue[RunRecord | BaseException | None] = asyncio.Queue()
        count = min(self._lanes, len(waiting))
        lanes = [
            asyncio.create_task(self._lane(self._engine_for(model, n), waiting, made))
            for n in range(count)
        ]
        try:
            while count:
                item = await made.get()
                if item is None:
                    count -= 1
                elif isinstance(item, BaseException):
                    raise item
                else:
                    self._results.add(item)
                    yield item
        finally:
            for lane in lanes:
                lane.cancel()
            await asyncio.gather(*lanes, return_exceptions=True)

    async def _lane(
        self,
        engine: MemoEngine,
        waiting: list[list[Job]],
        made: asyncio.Queue[RunRecord | BaseException | None],
    ) -> None:
        try:
            while waiting:
                for job in waiting.pop(0):
                    made.put_nowait(await self._make(job, engine))
        except Exception as error:
            made.put_nowait(error)
        finally:
            await engine.close()
        made.put_nowait(None)

    async def _make(self, job: Job, engine: MemoEngine) -> RunRecord:
        log = self._results.folder / LOGS / f"{job.stem}.jsonl" if self._keep_logs else None
        if log is not None:
            log.unlink(missing_ok=True)
        return await make_run(job, engine, partial(self._idle_score, job), log)

    def _idle_score(self, job: Job) -> Score:
        """Return the idle score of the job's mission, simulated once for all variants."""
        key = (job.mission_set, job.case.id, job.seed)
        if key not in self._idle:
            self._idle[key] = idle_score(job)
        return self._idle[key]


def idle_score(job: Job) -> Score:
    """Return the score of the job's mission if nothing is ordered."""
    return idle_run(job.case, job.site.world, job.seed, enforced_rules(job.site.rulebook))


def chunks(jobs: Sequence[Job]) -> list[list[Job]]:
    """Return the jobs in groups of CHUNK missions, each group with all variants."""
    cases = list(dict.fromkeys((job.mission_set, job.case.id, job.seed) for job in jobs))
    place = {case: number // CHUNK for number, case in enumerate(cases)}
    chunked: list[list[Job]] = [[] for _ in range(-(-len(cases) // CHUNK))]
    for job in jobs:
        chunked[place[job.mission_set, job.case.id, job.seed]].append(job)
    return chunked


def in_order(jobs: Sequence[Job]) -> list[Job]:
    """Return the jobs by model, in the order in which a single lane would run them."""
    by_model = groupby(jobs, key=lambda job: job.model)
    return [job for _, group in by_model for chunk in chunks(list(group)) for job in chunk]
