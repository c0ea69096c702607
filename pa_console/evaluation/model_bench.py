"""Runs a mission set through the whole pipeline with one model and tabulates what happened."""

from collections.abc import AsyncIterator, Callable

from pa_console.llm.engine import Engine
from pa_console.orchestrator.clock import SteppedClock
from pa_console.orchestrator.compose import Site, open_station
from pa_console.orchestrator.headless import Sink, run_missions, standing_approver
from pa_console.schema.base import StrictModel
from pa_console.schema.mission import MissionStatus
from pa_console.schema.mission_set import MissionCase, MissionSet
from pa_console.schema.variant import Variant
from pa_console.session.mission_trace import Attempt, MissionTrace

SinkFor = Callable[[MissionCase, str], Sink]


class BenchRow(StrictModel):
    """What one model made of one mission; seconds are wall time until the decision."""

    mission: str
    category: str
    valid_json: bool
    first_attempt: bool
    """The first plan broke no Critical or High rule."""
    after_repair: bool
    """Some plan, repaired ones included, broke none."""
    attempts: int
    judge: str
    executed: bool
    verified: bool
    status: MissionStatus
    reason: str
    decision_s: float
    first_token_s: float
    plan: str


class BenchTotal(StrictModel):
    """Counts over all missions of one model, and the median and longest decision time."""

    model: str
    missions: int
    valid_json: int
    first_attempt: int
    after_repair: int
    executed: int
    verified: int
    judged_success: int
    median_decision_s: float
    longest_decision_s: float


async def bench_model(
    site: Site, engine: Engine, missions: MissionSet, sink_for: SinkFor, seed: int = 0
) -> AsyncIterator[BenchRow]:
    """Yield one row a mission, each in a fresh world, plans approved only as the safeguards allow.

    `sink_for` gives, for a mission and its session id, what is told of every event.
    """
    for case in missions.missions:
        station = open_station(
            site,
            engine,
            SteppedClock(),
            seed=seed,
            keep_engine=True,
            variant=Variant(workflows=False),
        )
        traces = await run_missions(
            station,
            [case.command],
            standing_approver("auto"),
            sink_for(case, station.session),
            case.setup,
        )
        yield _row(case, traces[0])


def total(model: str, rows: list[BenchRow]) -> BenchTotal:
    """Sum `rows` up; raises ValueError when there are none."""
    if not rows:
        raise ValueError("no mission was run")
    seconds = sorted(row.decision_s for row in rows)
    return BenchTotal(
        model=model,
        missions=len(rows),
        valid_json=sum(row.valid_json for row in rows),
        first_attempt=sum(row.first_attempt for row in rows),
        after_repair=sum(row.after_repair for row in rows),
        executed=sum(row.executed for row in rows),
        verified=sum(row.verified for row in rows),
        judged_success=sum(row.judge == "Success" for row in rows),
        median_decision_s=seconds[len(seconds) // 2],
        longest_decision_s=seconds[-1],
    )


def _row(case: MissionCase, trace: MissionTrace) -> BenchRow:
    metrics = trace.metrics
    if metrics is None or trace.status is None:
        raise ValueError(f"{case.id}: the mission did not end")
    sound = [_sound(attempt) for attempt in trace.attempts]
    chosen = next((a for a in reversed(trace.attempts) if a.judged), None)
    last = chosen or (trace.attempts[-1] if trace.attempts else None)
    plan = last.plan if last is not None else None
    return BenchRow(
        mission=case.id,
        category=case.category,
        valid_json=bool(trace.attempts) and trace.attempts[0].plan is not None,
        first_attempt=sound[:1] == [True],
        after_repair=any(sound),
        attempts=len(trace.attempts),
        judge=chosen.verdict.verdict if chosen is not None and chosen.verdict else "none",
        executed=bool(trace.commands),
        verified=trace.status == "verified",
        status=trace.status,
        reason=trace.reason,
        decision_s=metrics.retrieval_s
        + metrics.picture_s
        + metrics.prompt_s
        + metrics.planning_s
        + metrics.checks_s
        + metrics.rehearsal_s
        + metrics.judging_s,
        first_token_s=metrics.first_token_s,
        plan="; ".join(f"{a.agent} {a.command}" for a in plan.actions) if plan else "",
    )


def _sound(attempt: Attempt) -> bool:
    return attempt.plan is not None and not any(f.blocking for f in attempt.findings)
