"""The ablations by name: each changes one part of the pipeline, all else being equal."""

from pa_console.schema.event import MOST_READINGS
from pa_console.schema.variant import Variant

REFERENCE = "one-plan"
"""What the ablations are compared with: the whole pipeline with one plan a mission."""

_ONE_PLAN = Variant(name=REFERENCE, workflows=False)


def _without(name: str, **changes: object) -> Variant:
    return Variant.model_validate({**_ONE_PLAN.model_dump(), "name": name, **changes})


ABOUT: dict[str, str] = {
    "full": "the console's own pipeline; a workflow may take several plans",
    REFERENCE: "the same with one plan a mission",
    "no-retrieval": "one-plan with the Critical rules alone in the prompt",
    "no-pinned": "one-plan with the three best rules alone in the prompt",
    "no-rules": "one-plan without any rule in the prompt",
    "no-safeguards": "one-plan without checks, premises and monitor; nothing blocks a plan",
    "no-rehearsal": "one-plan, checked as if every order succeeded at once",
    "no-judge": "one-plan without the JudgeLLM",
    "no-repair": "one-plan; the first plan stands",
    "one-candidate": "one-plan; one plan a prompt, a broken one is repaired at once",
    "four-candidates": "one-plan; of 4 plans the best when the first is broken, as by default",
    "eight-candidates": "one-plan; of 8 plans the best when the first is broken",
    "unfitted": "one-plan; a plan that is not what its planner says was asked stands",
    "one-reading": "one-plan; an idle or doubtful plan stands, whatever the judge has read",
    "unread": "one-plan; no other readings of an unclear command are looked for",
    "reading-1": "one-plan; the first of the other readings that are offered, if any, is chosen",
    "reading-2": "one-plan; the second of them, if there are so many",
    "reading-3": "one-plan; the third of them, if there are so many",
    "ungrounded": "one-plan; the planner's reason may state what the picture denies",
    "no-grammar": "one-plan; the planner writes whatever it likes",
    "paper-retrieval": "one-plan with the paper's retrieval",
    "paper": "the paper's retrieval, prompt and judge; no checks, rehearsal, repair or grammar",
}
"""What each variant is, in the order of the tables."""

VARIANTS: dict[str, Variant] = {
    variant.name: variant
    for variant in (
        Variant(),
        _ONE_PLAN,
        _without("no-retrieval", retrieval=False),
        _without("no-pinned", pinned=False),
        _without("no-rules", retrieval=False, pinned=False),
        _without("no-safeguards", checks=False, repairs=0),
        _without("no-rehearsal", rehearsal=False),
        _without("no-judge", judging=False),
        _without("no-repair", repairs=0),
        _without("one-candidate", candidates=1),
        _without("four-candidates", candidates=4),
        _without("eight-candidates", candidates=8),
        _without("unfitted", fitting=False),
        _without("one-reading", second_reading=False),
        _without("unread", readings=0),
        *(_without(f"reading-{n}", reading=n) for n in range(1, MOST_READINGS + 1)),
        _without("ungrounded", grounded=False),
        _without("no-grammar", grammar=False),
        _without("paper-retrieval", method="paper"),
        _without(
            "paper",
            method="paper",
            pinned=False,
            checks=False,
            rehearsal=False,
            repairs=0,
            grammar=False,
            prompt="paper",
        ),
    )
}


def find_variant(name: str) -> Variant:
    """Return the variant called `name`; raises ValueError with the known names."""
    if name not in VARIANTS:
        raise ValueError(f"unknown variant {name!r}; known: {', '.join(VARIANTS)}")
    return VARIANTS[name]
