"""Step 9: the verification of a plan by telemetry; an unknown outcome never counts as a pass.

A pass requires fresh and plausible reports that were sent at or after the end of the command. A
device's own *done* proves nothing. The judge's verdict on the outcome does not change the result.
It is requested while the model is idle, and emitted as a separate event.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Coroutine, Iterator, Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import NamedTuple

from pa_console.language.canonical.reading import read_asked
from pa_console.llm.backend import CANCELLED
from pa_console.llm.roles.grammar import PLANNED, verdict_schema
from pa_console.llm.roles.judge import Judgement, JudgeQuestion
from pa_console.llm.roles.role_model import PromptFormat, RoleModel, first_answer
from pa_console.mission.context import MissionContext
from pa_console.mission.execute import EPSILON_S, ExecutedPlan, cover_stamp, doubt_of
from pa_console.mission.execution.dispatch import TIMED_OUT
from pa_console.mission.judge import compared_grammar
from pa_console.mission.planning.moves import PlanMoves
from pa_console.mission.planning.picture_text import digest_picture
from pa_console.schema.command import CommandReply
from pa_console.schema.events import event as ev
from pa_console.schema.mission import ActionOutcome, Mission, Outcome, Verification
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import AssetTelemetry, Picture, Selection, Track
from pa_console.schema.world import World

STILL_MPS = 0.5

Start = Callable[[Coroutine[None, None, object]], object]
"""A function that starts a coroutine to run alongside the session."""


class _Conclusion(NamedTuple):
    """A conclusion from telemetry, its reason, and the time of the oldest report that it uses."""

    outcome: Outcome
    reason: str
    stamp_s: float | None = None


@dataclass(frozen=True)
class _Evidence:
    """The pictures before and after a plan, and the end of one command in simulated seconds."""

    world: World
    before: Picture
    after: Picture
    end_s: float


def verify(
    context: MissionContext, plan: Plan, executed: ExecutedPlan, step: int = 0
) -> Verification:
    """Compare the present telemetry with the effects that an executed plan should have (step 9).

    The plan must not have been halted. `step` is the number of `plan` among the steps of the
    approved plan; 0 for a whole plan.
    """
    started, fleet = perf_counter(), context.services.fleet
    before, after = executed.before, fleet.picture()
    verification = verify_plan(plan, fleet.world, before, after, executed.ended)
    seconds = perf_counter() - started
    context.emit(ev.MissionVerified(verification=verification, seconds=seconds, step=step))
    return verification


def verify_plan(
    plan: Plan, world: World, before: Picture, after: Picture, final: Mapping[str, CommandReply]
) -> Verification:
    """Compare the picture `after` with the effect that every action should have.

    `final` maps each agent to the last reply to its command; the tick of the reply is the end of
    the command. If a gate was covered before and is uncovered now, the outcome is a failure
    whatever the actions achieved (WF-03). If the gate's cover is unknown now, the outcome is
    unknown at best.
    """
    ends = {agent: reply.tick * world.dt_s for agent, reply in final.items()}
    seen = [
        _action(
            action,
            _Evidence(world, before, after, ends.get(action.agent, 0.0)),
            final.get(action.agent),
        )
        for action in plan.actions
    ]
    gates = dict(_gates(before, after, max(ends.values(), default=0.0)))
    actions = tuple(
        ActionOutcome(agent=a.agent, command=a.command, outcome=s.outcome, reason=s.reason)
        for a, s in zip(plan.actions, seen, strict=True)
    )
    outcome, reason = _overall(actions, gates)
    stamps = [s.stamp_s for s in (*seen, *gates.values()) if s.stamp_s is not None]
    return Verification(
        outcome=outcome,
        actions=actions,
        gates_lost=tuple(gate for gate, s in gates.items() if s.outcome == "fail"),
        gates_unknown=tuple(gate for gate, s in gates.items() if s.outcome == "unknown"),
        reason=reason,
        as_of_s=min(stamps, default=after.time_s),
    )


def _overall(
    actions: tuple[ActionOutcome, ...], gates: Mapping[str, _Conclusion]
) -> tuple[Outcome, str]:
    """Return the worst outcome of all actions and gates, with the reasons for it."""
    reasons: dict[Outcome, list[str]] = {"fail": [], "unknown": [], "pass": []}
    for gate, seen in gates.items():
        reasons[seen.outcome].append(f"{gate} {seen.reason}")
    for action in actions:
        name = f"{action.agent} {action.command}" if action.outcome == "fail" else action.agent
        reasons[action.outcome].append(f"{name}: {action.reason}")
    if reasons["fail"]:
        return "fail", "; ".join(reasons["fail"])
    if reasons["unknown"]:
        return "unknown", "; ".join(reasons["unknown"])
    return "pass", "telemetry shows every action and every gate's cover"


def _gates(before: Picture, after: Picture, end_s: float) -> Iterator[tuple[str, _Conclusion]]:
    """Yield each gate that was covered before the plan, with the conclusion about its cover now."""
    for gate, was in before.gates.items():
        if not was.covered:
            continue
        now = after.gates.get(gate)
        if now is None or now.unknown:
            unsure = f", {', '.join(now.unsure)} cannot be relied on" if now is not None else ""
            yield gate, _Conclusion("unknown", f"cover is unknown{unsure}")
        elif not now.covered:
            yield gate, _Conclusion("fail", "is no longer covered")
        else:
            stamp_s = cover_stamp(now, after)
            if stamp_s < end_s - EPSILON_S:
                yield (
                    gate,
                    _Conclusion("unknown", "has not been reported covered since the plan ended"),
                )
            else:
                yield gate, _Conclusion("pass", "is covered", stamp_s)


def _action(action: Action, evidence: _Evidence, reply: CommandReply | None) -> _Conclusion:
    """Verify one action; it fails if telemetry contradicts it, even without an answer."""
    after = evidence.after
    asset = after.assets.get(action.agent)
    if asset is None:
        return _Conclusion("unknown", "no telemetry of this asset")
    silent = reply is None or reply.detail.startswith(TIMED_OUT)
    if reply is not None and reply.status != "done" and not silent:
        return _Conclusion("fail", reply.detail or reply.status, asset.stamp_s)
    doubt = doubt_of(asset, after, evidence.end_s)
    if after.time_s - asset.stamp_s > evidence.world.stale_s and not doubt:
        doubt = f"the last telemetry is {after.time_s - asset.stamp_s:.0f} s old"
    if doubt:
        return _Conclusion("unknown", doubt)
    seen = _seen(action, evidence, asset)
    if silent and seen.outcome == "pass":
        detail = reply.detail if reply is not None else "the device never answered"
        return _Conclusion("unknown", f"{detail}; telemetry: {seen.reason}", seen.stamp_s)
    return seen


def _seen(action: Action, evidence: _Evidence, asset: AssetTelemetry) -> _Conclusion:
    """Verify one action by telemetry alone, given a fresh and plausible report of the asset."""
    place = asset.at or "between frames"
    stamp_s = asset.stamp_s
    if asset.status == "failed":
        return _Conclusion("fail", f"it has failed, {place}", stamp_s)
    match action.verb:
        case "hold":
            still = asset.speed_mps < STILL_MPS
            outcome, reason = ("pass", f"still at {place}") if still else ("fail", "still moving")
            return _Conclusion(outcome, reason, stamp_s)
        case "report":
            return _Conclusion("pass", f"report received, at {place}", stamp_s)
        case "identify" | "warn":
            seen = _tracks(action, evidence)
            stamps = [s for s in (seen.stamp_s, stamp_s) if s is not None]
            return _Conclusion(seen.outcome, seen.reason, min(stamps))
        case "move_to" | "observe" | "block" | "return_to_base":
            target = action.target or evidence.world.base
    if asset.at != target:
        return _Conclusion("fail", f"it is at {place}", stamp_s)
    if asset.post != target:
        heading = asset.post or "elsewhere"
        return _Conclusion("fail", f"it is at {place} on its way to {heading}", stamp_s)
    return _Conclusion("pass", f"at {target}", stamp_s)


def _tracks(action: Action, evidence: _Evidence) -> _Conclusion:
    """Verify an `identify` or `warn` by the tracks that sensors now report at its frame."""
    here = [track for track in evidence.after.tracks.values() if track.gate == action.target]
    if not here:
        return _Conclusion("unknown", "the track is gone")
    fresh = [t for t in here if not t.stale and t.stamp_s >= evidence.end_s - EPSILON_S]
    if not fresh:
        latest = max(here, key=lambda track: (track.stamp_s, track.id))
        age = evidence.after.time_s - latest.stamp_s
        return _Conclusion("unknown", f"{latest.id} has not been seen for {age:.0f} s")
    due = [track for track in fresh if _dealt_with(action, track)]
    left = [track for track in fresh if not _dealt_with(action, track)]
    earlier = evidence.before.tracks
    new = [t for t in due if t.id not in earlier or not _dealt_with(action, earlier[t.id])]
    stamp_s = min(track.stamp_s for track in fresh)
    done, undone = (
        ("identified", "still unidentified")
        if action.verb == "identify"
        else ("warned", "not warned")
    )
    if new or (due and not left):
        return _Conclusion("pass", f"{done} {', '.join(t.id for t in new or due)}", stamp_s)
    return _Conclusion("fail", f"{', '.join(track.id for track in left)} {undone}", stamp_s)


def _dealt_with(action: Action, track: Track) -> bool:
    return track.identity != "unknown" if action.verb == "identify" else track.warned


@dataclass(frozen=True)
class OutcomeCase:
    """An executed plan with its verification, and the pictures `before` and after it.

    `selection` is the part of the picture from which the plan was made; None means all of it.
    `feedback` is the judge's feedback on the plan, from which its reading of the order is reused.
    """

    task: Mission
    before: Picture
    picture: Picture
    selection: Selection | None
    plan: Plan
    verification: Verification
    feedback: str = ""


def ask_about_outcome(
    prompt_format: PromptFormat, world: World, case: OutcomeCase
) -> JudgeQuestion:
    """Return the question to the judge whether the task was accomplished (step 9)."""
    digest = digest_picture(case.picture, world, case.selection)
    prompt = prompt_format.outcome(world, digest, case.task, case.plan, case.verification)
    if prompt_format.outcome_opening is None:
        schema = verdict_schema([])
        return JudgeQuestion("outcome", prompt, prompt_format.verdict([]), schema=schema)
    moves = PlanMoves(world, case.before, case.plan)

    def goes_on(opening: str) -> str:
        return compared_grammar(opening, moves, executed=True)

    reading, compared, _ = case.feedback.partition(PLANNED)
    if compared and read_asked(reading) is not None:
        return JudgeQuestion("outcome", prompt, goes_on(f'{{"feedback": "{reading}{PLANNED}'))
    return JudgeQuestion("outcome", prompt, prompt_format.outcome_opening, goes_on=goes_on)


@dataclass(frozen=True)
class _Verification:
    """An executed plan that awaits a verdict; `attempt` is its number in the mission."""

    context: MissionContext
    attempt: int
    case: OutcomeCase


class OutcomeVerdicts:
    """The outstanding verdicts on outcomes in a session, requested one by one, oldest first.

    If a mission needs the model, the request in progress is interrupted and repeated later.
    """

    def __init__(self, start: Start, *, between_missions: bool) -> None:
        """Request verdicts in coroutines that `start` runs.

        With `between_missions`, verdicts are requested only between missions. In runs in which the
        simulation waits for the model, verdicts then do not add to the time of a mission.
        """
        self._start, self._between_missions = start, between_missions
        self._waiting: deque[_Verification] = deque()
        self._turn = asyncio.Lock()
        self.all_settled = asyncio.Event()
        """Set while no verdict is outstanding."""
        self.all_settled.set()

    def ask(self, context: MissionContext, attempt: int, case: OutcomeCase) -> None:
        """Queue a request for a verdict on the outcome of the executed plan `attempt`."""
        self._waiting.append(_Verification(context, attempt, case))
        self.all_settled.clear()

    def go_on(self) -> None:
        """Begin to request outstanding verdicts while the mission does not need the model."""
        if self._waiting and not self._between_missions and not self._turn.locked():
            self._start(self.work())

    async def work(self) -> bool:
        """Request every outstanding verdict; return False if a mission needed the model meanwhile.

        In that case, the remaining verdicts wait for the next call.
        """
        async with self._turn:
            while self._waiting:
                outstanding = self._waiting[0]
                verdict = await _verdict_on(outstanding)
                if verdict.error == CANCELLED:
                    return False
                self._tell(verdict)
            return True

    def give_up(self, reason: str) -> None:
        """Emit, for each outstanding verdict, an event with the `reason` why it was not given."""
        while self._waiting:
            self._tell(unjudged(self._waiting[0].attempt, reason))

    def _tell(self, verdict: ev.OutcomeJudged) -> None:
        """Emit `verdict`, which answers the oldest request, and remove that request."""
        self._waiting.popleft().context.emit(verdict)
        if not self._waiting:
            self.all_settled.set()


async def _verdict_on(outstanding: _Verification) -> ev.OutcomeJudged:
    """Return the requested verdict, or the reason why there is no verdict."""
    services = outstanding.context.services

    async def ask(model: RoleModel) -> Judgement:
        question = ask_about_outcome(model.prompt_format, services.fleet.world, outstanding.case)
        return await model.judge.judge(question)

    try:
        judgement = await first_answer(services.judges, ask, outstanding.context.turn_to_own)
    except Exception as error:  # a bug must not end the session
        return unjudged(outstanding.attempt, f"internal error: {type(error).__name__}: {error}")
    return ev.OutcomeJudged(
        attempt=outstanding.attempt,
        verdict=judgement.verdict,
        error=judgement.error,
        usage=judgement.usage,
    )


def unjudged(attempt: int, reason: str) -> ev.OutcomeJudged:
    """Return the event that reports that there is no verdict on the outcome of `attempt`."""
    return ev.OutcomeJudged(attempt=attempt, verdict=None, error=reason)
