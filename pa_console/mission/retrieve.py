"""Step 3 of a mission: the rules in the planner's prompt."""

from dataclasses import dataclass
from time import perf_counter

from pa_console.mission.context import MissionContext
from pa_console.schema.command import Verb
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission
from pa_console.schema.rule import RuleHit


@dataclass(frozen=True)
class RetrievedRules:
    """The task of the next plan, and the rules in the prompt for that plan.

    `task` is the mission itself, or a phase of its workflow. If `verbs` are given, the planner may
    use no other commands. `chosen` is the reading of the task that the operator chose; '' if the
    planner has to read the task.
    """

    task: Mission
    hits: tuple[RuleHit, ...]
    verbs: tuple[Verb, ...] = ()
    chosen: str = ""

    @property
    def rule_ids(self) -> tuple[str, ...]:
        """The ids of the rules that were retrieved for the task."""
        return tuple(hit.rule_id for hit in self.hits)


def retrieve(
    context: MissionContext, task: Mission, verbs: tuple[Verb, ...] = (), chosen: str = ""
) -> RetrievedRules:
    """Retrieve the rules that concern the words of `task`, and the pinned rules (step 3).

    The variant determines whether pinned rules, the best matches or both are retrieved.
    """
    started = perf_counter()
    retriever, variant = context.services.retriever, context.services.variant
    top_k = context.services.top_k if variant.retrieval else 0
    if variant.pinned:
        hits = retriever.retrieve(task.text, top_k)
    else:
        best = retriever.score_all(task.text)[:top_k]
        hits = tuple(hit.model_copy(update={"pinned": False}) for hit in best)
    seconds = perf_counter() - started
    context.stopwatch.add("retrieval_s", seconds)
    context.emit(ev.RulesRetrieved(method=retriever.method, hits=hits, seconds=seconds))
    return RetrievedRules(task, hits, verbs, chosen)
