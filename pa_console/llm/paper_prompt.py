"""The paper's own planner prompt (Section IV-D), kept for comparison with the console's."""

from collections.abc import Sequence

from pa_console.llm.facts import vocabulary
from pa_console.llm.prompts import Prompt
from pa_console.schema.mission import Mission
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import World

SYSTEM = "You are the decision engine of a checkpoint's edge command center."


def paper_prompt(world: World, digest: Digest, rules: Sequence[Rule], mission: Mission) -> Prompt:
    """Return mission command, instruction, state, retrieved context and output format, in order.

    The paper shows its prompt in simplified form only: the command templates that it speaks of
    are ours, and a device's state is where it stands and what it does.
    """
    state = [f"{name}: {post}" for name, post in digest.posts.items()]
    state += [f"{name}: unavailable" for name in digest.down]
    context = [f"{rule.id}: {' '.join(rule.text.split())}" for rule in rules]
    user = [
        f"Mission Command: {' '.join(mission.text.split())}",
        "",
        "Instruction: Return only valid JSON; use predefined device names and command templates; "
        "preserve command order; maintain gate coverage.",
        "",
        vocabulary(world),
        "",
        "Current State:",
        *(state or ["none"]),
        "",
        "Retrieved Context:",
        *(context or ["none"]),
        "",
        "Expected Output Format:",
        '{"actions": [{"agent": "<agent>", "command": "<command>"}], '
        '"reason": "<short explanation>"}',
    ]
    return Prompt(SYSTEM, "\n".join(user))
