"""Recognises questions that are answered from the record among the texts that were typed."""

from dataclasses import replace

from pa_console.language.questions.question import Question
from pa_console.language.questions.question_grammar import read_question
from pa_console.language.references.scene import Scene
from pa_console.orchestrator.intake.spelling_correction import read_words
from pa_console.policy.checks.plain_text import compatible_form
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.mission import MAX_MISSION_TEXT

IS_QUESTION = "this is a question: it is answered where it is asked, and no mission is made of it"
NO_QUESTION = (
    "this is no question that is answered here; those are Why?, Why ASSET?, Why not ASSET?, "
    "Why is nobody at GATE? and What would you do instead?"
)


def question_in(text: str, scene: Scene, rulebook: Rulebook) -> Question | None:
    """Return the question about the record in `text`; None for an order.

    Slips of the hand are put right as in an order, and the typed text is kept.
    """
    if len(text) > MAX_MISSION_TEXT:
        return None
    plain = " ".join(compatible_form(text).split())
    found = read_question(scene, read_words(plain, scene.world, rulebook))
    return replace(found, text=" ".join(text.split())) if found is not None else None
