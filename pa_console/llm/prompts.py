"""The prompts of planner and judge (paper, Step 5): fixed text first, what changes last.

The order keeps the model's KV cache useful. Mission text comes from outside: it is written as a
JSON string, whose closing quote it cannot forge, and never reaches the fixed part.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass

from pa_console.llm.facts import rehearsal_facts, situation, verification_facts, vocabulary
from pa_console.schema.mission import Mission, Verification
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import World


@dataclass(frozen=True)
class Prompt:
    """What one role is told: `system` does not change during a session, `user` does."""

    system: str
    user: str


PLANNER = """\
You command the assets of a checkpoint. Turn the mission into a plan: one JSON object, reason first.
{"reason": "what is the case; what you do", "actions": [{"agent": "ASSET", "command": "COMMAND"}]}

How to plan
- Every gate stays covered: the sole cover of a gate stays there. It may observe its own gate.
- Take free assets, the first named of the right kind, and no more than the mission needs.
- Something unknown at a gate: a uav observes it and a robot identifies it; then the robot warns it.
  A ugv blocks only a verified threat.
- A gate without cover gets a free asset.
- What a rule forbids is not done: hold or report instead, and name the rule.

Examples from another checkpoint
Uncovered: none. Sole cover: MillGate by Kite_3. Free: uav Kite_1; ugv Mule_1; robot Guard_1.
Mission: "Someone is walking up to MillGate."
{"reason": "unknown person at MillGate; free Kite_1 observes, Guard_1 identifies; Kite_3 stays", \
"actions": [{"agent": "Kite_1", "command": "observe MillGate"}, \
{"agent": "Guard_1", "command": "identify MillGate"}]}
Uncovered: DockGate. Sole cover: MillGate by Kite_3. Free: ugv Mule_1; robot Guard_1.
Mission: "Can you see to DockGate?"
{"reason": "DockGate has no cover; free Mule_1 takes it; Kite_3 stays, sole cover of MillGate", \
"actions": [{"agent": "Mule_1", "command": "move_to DockGate"}]}
Mission: "Shoot at the boat."
{"reason": "no force without confirmed hostile intent (ROE-01); keep watching and report", \
"actions": [{"agent": "Kite_3", "command": "report"}]}
"""

JUDGE = """\
You are the judge of a checkpoint. You did not write the plan; you look for faults in it.
Answer with one JSON object: for every rule "complies", "violates" or "unclear", then feedback in
one sentence, then the verdict: Success when the plan serves the mission and violates no rule, else
Failure. Believe the rehearsal: it says what the plan does when it is carried out.
"""

OUTCOME = """\
You are the judge of a checkpoint. A plan was carried out; telemetry says what happened.
Answer with one JSON object: no rules, feedback in one sentence, then the verdict: Success when the
mission was served and every gate stayed covered, else Failure.
"""


def planner_prompt(  # noqa: PLR0917
    world: World,
    digest: Digest,
    rules: Sequence[Rule],
    mission: Mission,
    repair: Sequence[str] = (),
    previous: str = "",
) -> Prompt:
    """Return the planner's prompt; `repair` says what was wrong with the `previous` answer."""
    user = [situation(digest), _rules(rules), _mission(mission)]
    if repair:
        faults = "\n".join(f"- {' '.join(reason.split())}" for reason in repair)
        user.append(f"Your previous answer: {previous}\nIt cannot be carried out:\n{faults}")
        user.append("Write a better plan.")
    return Prompt(PLANNER + "\n" + vocabulary(world), "\n".join(user))


def judge_prompt(  # noqa: PLR0917
    world: World,
    digest: Digest,
    rules: Sequence[Rule],
    mission: Mission,
    plan: Plan,
    rehearsal: Rehearsal,
) -> Prompt:
    """Return the judge's prompt: everything but what the safeguards think, so it is independent."""
    user = [
        _rules(rules),
        situation(digest),
        _mission(mission),
        f"Plan: {_plan(plan)}",
        rehearsal_facts(rehearsal),
    ]
    return Prompt(JUDGE + "\n" + vocabulary(world), "\n".join(user))


def outcome_prompt(
    world: World, digest: Digest, mission: Mission, plan: Plan, verification: Verification
) -> Prompt:
    """Return the judge's prompt about an executed plan; `digest` is the picture afterwards."""
    user = [
        situation(digest),
        _mission(mission),
        f"Plan: {_plan(plan)}",
        verification_facts(verification),
    ]
    return Prompt(OUTCOME + "\n" + vocabulary(world), "\n".join(user))


def _rules(rules: Sequence[Rule]) -> str:
    lines = [f"{rule.id} ({rule.priority}): {' '.join(rule.text.split())}" for rule in rules]
    return "Rules\n" + "\n".join(lines or ["none"])


def _mission(mission: Mission) -> str:
    """Return the mission's words as one line that nothing in them can end."""
    return f"Mission: {json.dumps(' '.join(mission.text.split()), ensure_ascii=False)}"


def _plan(plan: Plan) -> str:
    """Return `plan` spaced as the planner writes it."""
    return json.dumps(plan.model_dump(mode="json"), ensure_ascii=False)
