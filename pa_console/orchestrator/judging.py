"""What the judge is asked: of a plan before it is executed, and of its outcome afterwards."""

from collections.abc import AsyncGenerator, Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Literal

from pa_console.llm.dialect import Dialect
from pa_console.llm.grammar import PLANNED, hinted
from pa_console.llm.judge import Judge, Judgement
from pa_console.llm.prompts import Prompt
from pa_console.llm.reading import read_asked
from pa_console.orchestrator.candidate import Candidate
from pa_console.orchestrator.comparing import compared_grammar
from pa_console.orchestrator.digest import digest_picture
from pa_console.orchestrator.plan_moves import PlanMoves
from pa_console.orchestrator.services import Payloads, Services, Stopwatch
from pa_console.policy.rulebook import Rulebook
from pa_console.schema import event as ev
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission, Verification
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import RuleHit
from pa_console.schema.telemetry import Digest, Picture, Selection
from pa_console.schema.world import World


@dataclass(frozen=True)
class PlanCase:
    """A plan for `task`, with the rules and the picture that its planner was given.

    `asked` is what the operator says was asked; '' where the judge is to read that.
    """

    task: Mission
    hits: Sequence[RuleHit]
    digest: Digest
    plan: Plan
    findings: Sequence[Finding]
    rehearsal: Rehearsal
    asked: str = ""


@dataclass(frozen=True)
class OutcomeCase:
    """An executed plan: pictures `before` and after it, and what telemetry says of every action.

    `selection` is the part of the picture that the plan was made from; None means all of it. `said`
    is what the judge said of the plan, if it was asked about that too: what was asked is read once.
    """

    task: Mission
    before: Picture
    picture: Picture
    selection: Selection | None
    plan: Plan
    verification: Verification
    said: str = ""


@dataclass(frozen=True)
class JudgeQuestion:
    """A prompt for the judge and the grammar of its answer; opinions are wanted on `rule_ids`."""

    role: Literal["judge", "outcome"]
    prompt: Prompt
    grammar: str
    rule_ids: tuple[str, ...] = ()
    goes_on: Callable[[str], str] | None = None
    """Where `grammar` is of the beginning alone: the grammar of the whole, for what it begins with.
    """
    hint: str = ""
    """What the answer may repeat: the planner's words for what was asked. They save time only; the
    judge writes what it would have written without them."""

    def put_to(self, judge: Judge) -> AsyncGenerator[str | Judgement]:
        """Ask `judge`; gives the answer in pieces, then one Judgement."""
        return judge.judge(
            self.prompt, self.grammar, self.role, self.rule_ids, self.goes_on, self.hint
        )


def ask_about_plan(
    dialect: Dialect, world: World, rulebook: Rulebook, case: PlanCase
) -> JudgeQuestion:
    """Step 6: return the question whether the plan serves the task within the rules.

    Raises KeyError when a rule that was retrieved or found broken is not in `rulebook`.
    """
    rules = [rulebook.get(id_) for id_ in judged_rules(case.hits, case.findings)]
    prompt = dialect.judge(world, case.digest, rules, case.task, case.plan, case.rehearsal)
    ids = tuple(rule.id for rule in rules)
    if dialect.opening is None:
        return JudgeQuestion("judge", prompt, dialect.verdict(ids), ids)
    moves = PlanMoves(world, case.rehearsal.before, case.plan)

    def goes_on(opening: str) -> str:
        return compared_grammar(opening, moves, ids)

    opening = dialect.opening(world, case.digest, case.task.text, case.asked)
    return JudgeQuestion("judge", prompt, opening, ids, goes_on, hint=hinted(case.plan.reason))


async def judge_plan(
    services: Services, watch: Stopwatch, case: PlanCase, candidate: Candidate
) -> Payloads:
    """Step 6: ask the judge about the plan of `candidate`, which takes the verdict."""
    started = perf_counter()
    asked = ask_about_plan(services.dialect, services.sim.world, services.rulebook, case)
    yield ev.PromptBuilt(
        role="judge",
        attempt=candidate.attempt,
        system=asked.prompt.system,
        user=asked.prompt.user,
        seconds=perf_counter() - started,
    )
    with watch.time("judging_s"):
        async for piece in asked.put_to(services.judge):
            if isinstance(piece, str):
                yield ev.TextStreamed(role="judge", attempt=candidate.attempt, text=piece)
            else:
                candidate.verdict, candidate.judge_error = piece.verdict, piece.error
                candidate.judge_confidence = None if case.asked else piece.confidence
                yield ev.PlanJudged(
                    attempt=candidate.attempt,
                    verdict=piece.verdict,
                    error=piece.error,
                    usage=piece.usage,
                    confidence=candidate.judge_confidence,
                )


def ask_about_outcome(dialect: Dialect, world: World, case: OutcomeCase) -> JudgeQuestion:
    """Step 7: return the question whether the task was accomplished."""
    digest = digest_picture(case.picture, world, case.selection)
    prompt = dialect.outcome(world, digest, case.task, case.plan, case.verification)
    if dialect.outcome_opening is None:
        return JudgeQuestion("outcome", prompt, dialect.verdict([]))
    moves = PlanMoves(world, case.before, case.plan)

    def goes_on(opening: str) -> str:
        return compared_grammar(opening, moves, executed=True)

    asked, compared, _ = case.said.partition(PLANNED)
    if compared and read_asked(asked) is not None:
        return JudgeQuestion("outcome", prompt, goes_on(f'{{"feedback": "{asked}{PLANNED}'))
    return JudgeQuestion("outcome", prompt, dialect.outcome_opening, goes_on=goes_on)


def judged_rules(hits: Sequence[RuleHit], findings: Sequence[Finding]) -> list[str]:
    """Return the ids of the retrieved rules that apply to the plan, and of every broken one."""
    found = {finding.rule_id: finding for finding in findings}
    ids = [
        hit.rule_id
        for hit in hits
        if hit.rule_id not in found or found[hit.rule_id].status != "not_applicable"
    ]
    return ids + [f.rule_id for f in findings if f.broken and f.rule_id not in ids]
