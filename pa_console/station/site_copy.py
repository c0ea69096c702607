"""The world and the rules of a session that was joined, as they are here: what answers rest on.

What has come of the session tells why a plan is as it is. What takes a rehearsal is rehearsed here,
over the last picture that has come; where this copy does not fit the session, that is said.
"""

from collections.abc import AsyncGenerator, Callable

from pa_console.fleets.simulated import ShownPicture
from pa_console.language.questions import Question
from pa_console.language.references.scene import Scene
from pa_console.policy.core_rules import with_core
from pa_console.policy.retriever import Retriever
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.evaluation import Variant
from pa_console.schema.events.intake import AnswerLine, QuestionAnswered, QuestionTopic
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import RehearsedReading
from pa_console.schema.world import World
from pa_console.session.state import SessionState
from pa_console.station.alternatives import Alternative, rehearse_other_ways, rehearse_reading
from pa_console.station.answering import Answer, answer
from pa_console.station.assembly import has_rules_of
from pa_console.station.intake import read_text

REHEARSED: frozenset[QuestionTopic] = frozenset({"other_asset", "alternatives"})
"""The notice that an answer here comes from new checks and rehearsals, not from the record."""
OTHER_RULES = "the rules in force there are not those that this console has"
NO_PICTURE = "no picture has come from there yet"


class SiteCopy:
    """A world and rules, and a question answered with them; no model is asked, nobody moves."""

    def __init__(self, world: World, rules: Rulebook) -> None:
        self.fleet, self.variant = ShownPicture(world), Variant()
        self.rulebook = with_core(rules)
        self.retriever = Retriever(rules.rules)
        self._rules = rules

    def question_in(self, text: str, state: SessionState, pointer: str) -> Question | None:
        """Return what `text` asks of the session in `state`; None for anything else.

        `pointer` is what is marked on the screen, '' for nothing. Without a picture nothing that
        words could point at is known, so nothing is a question.
        """
        if state.picture is None:
            return None
        scene = Scene(self.fleet.world, state.picture, pointer=pointer)
        return read_text(text, scene, self._rules).question

    async def answer(
        self,
        question: Question,
        state: SessionState,
        station: str,
        found: Callable[[Alternative], object],
    ) -> Answer:
        """Return the answer as far as it can be given here, else who can give it: `station`."""
        self.fleet.show(state.picture)
        if question.topic in REHEARSED and (why := self._unfit(state)):
            said = f"{why}, so it cannot be rehearsed here; ask it at {station}"
            told = QuestionAnswered(
                question=question.text,
                topic=question.topic,
                subjects=question.subjects,
                lines=(AnswerLine(about="not here", said=said),),
            )
            current = state.current
            return Answer(told, current.mission.id if current is not None else "")
        return await answer(self, question, state, found)

    async def look_at(
        self, state: SessionState, mission: Mission, asked: str
    ) -> RehearsedReading | None:
        """Return what another reading of a mission would lead to; None where that is not known."""
        self.fleet.show(state.picture)
        return None if self._unfit(state) else await rehearse_reading(self, mission, asked)

    async def other_ways(
        self, state: SessionState, mission: Mission, asked: str, but: Plan
    ) -> AsyncGenerator[RehearsedReading]:
        """Yield what else would serve a reading than the plan `but`, as far as that is known."""
        self.fleet.show(state.picture)
        if not self._unfit(state):
            async for found in rehearse_other_ways(self, mission, asked, but):
                yield found

    def _unfit(self, state: SessionState) -> str:
        """Return why nothing can be rehearsed here as it would be there, '' where it can."""
        if state.picture is None:
            return NO_PICTURE
        if state.started is None or not has_rules_of(state.started, self._rules):
            return OTHER_RULES
        return ""
