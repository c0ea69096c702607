"""How a judge's verdict goes on once it has said what was asked: the console compares the plan.

A small model reads an order far better than it compares two of them. So it says what was asked,
without having seen the plan; the console says what is planned and whether that is the same; and the
model ends with its verdict.
"""

import json
from collections.abc import Sequence
from typing import NamedTuple

from pa_console.llm.grammar import COMPARED_CHARS, PLANNED, compact_judge_grammar, exactly
from pa_console.llm.grounds import MOST_PLANNED, WORD
from pa_console.llm.plan_words import planned
from pa_console.llm.reading import read_asked
from pa_console.orchestrator.fulfilment import gaps
from pa_console.orchestrator.plan_moves import PlanMoves

FITS = "it fits"


class Compared(NamedTuple):
    """What the console writes after what was asked; `gaps` None where that cannot be read."""

    planned: str
    gaps: tuple[str, ...] | None

    @property
    def told(self) -> str:
        """What is planned, and how it compares; open at the end where that is for the model."""
        if self.gaps is None:
            return f"{self.planned}; "
        return f"{self.planned}; {'; '.join(self.gaps) or FITS}"


def compare(asked: str, moves: PlanMoves) -> Compared:
    """Compare a plan with what was `asked`, in a judge's words ("asked: 1 drone home")."""
    reading = read_asked(asked)
    words = _planned(asked, moves)
    if reading is None or not reading.readable:
        return Compared(words, None)
    return Compared(words, gaps(moves, reading))


def compared_grammar(
    opening: str, moves: PlanMoves, rule_ids: Sequence[str] = (), *, executed: bool = False
) -> str:
    """Return the grammar of a whole verdict that begins with `opening`.

    A plan that is not what was asked cannot be called a success. What the console cannot read is
    left to the model, as is which rules of `rule_ids` are violated, and of a plan that was
    `executed` what came of it.
    """
    asked = opening.partition(': "')[2].removesuffix(PLANNED)
    compared = compare(asked, moves)
    said = exactly((asked + PLANNED + compared.told)[:COMPARED_CHARS])
    if compared.gaps is None:
        said += f"{WORD}+"
    elif executed and not compared.gaps:
        said += f"; {WORD}+"
    verdicts = ("Failure",) if compared.gaps else ("Success", "Failure")
    return compact_judge_grammar(rule_ids, said, verdicts, COMPARED_CHARS)


def _planned(asked: str, moves: PlanMoves) -> str:
    """Return what is planned, by name where the order names assets."""
    actions, world = moves.plan.actions, moves.world
    by_name = any(name in asked for name in world.assets)
    words = planned(actions, world, by_name=by_name)
    if len(words) > MOST_PLANNED:
        words = planned(actions, world, by_name=False)[:MOST_PLANNED]
    return json.dumps(words)[1:-1]
