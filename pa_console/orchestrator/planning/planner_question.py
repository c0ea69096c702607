"""Steps 3 and 4: what the planner is asked, from the picture of the moment."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter

from pa_console.llm.roles.grammar import ANY_TEXT, plan_grammar
from pa_console.llm.roles.prompts import Prompt, paper_prompt
from pa_console.orchestrator.mission.services import Services
from pa_console.orchestrator.planning.digest import digest_picture
from pa_console.orchestrator.planning.picture_selection import select
from pa_console.orders.clause_grammar import asked_now
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Verb
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import Digest


@dataclass(frozen=True)
class Question:
    """A prompt for the planner and the grammar of its answer; `digest` is what it tells.

    Its reason matches `reasons`, regular expressions, and begins with `asked` where that is known.
    """

    digest: Digest
    prompt: Prompt
    grammar: str
    reasons: tuple[str, ...]
    asked: str
    picture_s: float
    prompt_s: float


def ask_for_plan(  # noqa: PLR0917
    services: Services,
    task: Mission,
    rules: Sequence[Rule],
    verbs: Sequence[Verb] = (),
    reasons: Sequence[str] = (),
    previous: str = "",
    chosen: str = "",
) -> Question:
    """Return the question for a plan for `task`; `reasons` are the faults of the `previous` one.

    With `verbs`, no other commands can be answered; `chosen` is what the operator says was asked.
    """
    started = perf_counter()
    picture, world = services.fleet.picture(), services.fleet.world
    selection = select(picture, world, task, rules)
    digest = digest_picture(picture, world, selection)
    digested = perf_counter()
    if services.variant.prompt == "paper":
        prompt = paper_prompt(world, digest, rules, task)
    else:
        prompt = services.dialect.planner(world, digest, rules, task, reasons, previous)
    grammar, stated, asked = ANY_TEXT, (), asked_now(world, digest, chosen)
    if services.variant.grammar:
        shown = (None, None) if selection is None else (selection.assets, selection.frames)
        if services.variant.grounded:
            stated = tuple(services.dialect.reason(world, digest, task.text, asked))
        grammar = plan_grammar(world, picture, *shown, verbs, stated)
    spent_s = perf_counter() - digested
    return Question(digest, prompt, grammar, stated, asked, digested - started, spent_s)
