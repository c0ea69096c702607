"""Step 2 with the operator: the reading of an order, and questions about its unclear words."""

from pa_console.language.references.resolution import chosen, names_something
from pa_console.mission.context import MissionContext, MissionResult
from pa_console.mission.decide import Decide, ask_back, offer_standing, unknown_place, unsettled
from pa_console.mission.plan import PlanForDecision
from pa_console.mission.spelling import read_words
from pa_console.mission.understand import (
    NotUnderstood,
    RefusedMission,
    StandingOffer,
    Understood,
    understand,
)
from pa_console.schema.mission import MAX_MISSION_TEXT

MOST_QUESTIONS = 2
"""The number of times that the operator may be asked what an order means."""


class OrderQuestions:
    """The questions about the order of one mission, and the operator's answers."""

    def __init__(self, context: MissionContext, decide: Decide) -> None:
        self._context, self._decide = context, decide
        self.answers: dict[str, str] = {}
        """The operator's answers, by the words of the mission that they explain."""
        self._count = 0

    async def understand(self, unclear: NotUnderstood | None) -> Understood | MissionResult:
        """Read the mission's words, and ask the operator about unclear ones (step 2).

        Returns the mission's result if the mission ends without a plan. If `unclear` is given, a
        question that arose during planning, it is asked first.
        """
        while True:
            reading = unclear or await understand(self._context, self.answers)
            unclear, number = None, self._count
            match reading:
                case RefusedMission(reason):
                    return MissionResult("refused", reason)
                case Understood() as understood:
                    return understood
                case StandingOffer() as offered:
                    return await offer_standing(self._context, offered, self._decide)
                case NotUnderstood(question) if number == MOST_QUESTIONS:
                    return MissionResult("held", f"not understood: {question}")
                case NotUnderstood() as question:
                    answer = await ask_back(self._context, question, number, self._decide)
                    if isinstance(answer, MissionResult):
                        return answer
                    self._count += 1
                    self._take_up(question, answer)

    def _take_up(self, question: NotUnderstood, answer: str) -> None:
        """Use an answer in place of the order's unclear words, or in place of the whole order.

        If the answer to unclear words names nothing, the same question is asked again.
        """
        mission, services = self._context.mission, self._context.services
        scene = services.scene
        meaning = chosen(scene, answer, question.choices) or read_words(
            answer, scene.world, services.rulebook
        )
        words = {"text": meaning[:MAX_MISSION_TEXT], "typed": answer[:MAX_MISSION_TEXT]}
        if question.words:
            if meaning in question.choices or names_something(scene, meaning):
                self.answers[question.words] = meaning
            words = {"typed": f"{mission.said} ({answer})"[:MAX_MISSION_TEXT]}
        else:
            self.answers.clear()
        self._context.mission = mission.model_copy(update=words)

    def left_by(
        self, planned: PlanForDecision, understood: Understood | None
    ) -> NotUnderstood | None:
        """Return the question that a plan leaves open; None without one, or after too many."""
        if self._count >= MOST_QUESTIONS:
            return None
        question = understood.unsettled if understood is not None else None
        world = self._context.services.fleet.world
        return unknown_place(planned, world) or unsettled(planned, question)
