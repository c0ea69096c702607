"""The prompts of planner and judge (paper, Step 5): fixed text first, changing text last.

With this order, the model's KV cache can be reused. Mission text comes from outside. Therefore, it
is never in the fixed part, and is written as a JSON string, so that it cannot forge the closing
quote.

Adapters are trained on other prompts, without instructions or examples (`compact_prompts.py`).
"""

import json
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pa_console.schema.command import COMMANDS
from pa_console.schema.events.event import Role
from pa_console.schema.mission import Mission, Verification
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import PLAIN_KINDS, World

FEW_FRAMES = 24
"""The number of frames above which a prompt has only the relevant ones."""
MOST_PROBLEMS = 24
NO_PROBLEM = "no problem, so every rule complies"
_PIECE = re.compile(rb"[A-Z]?[a-z]{1,5}|[^ a-z]")
"""A regular expression for a short word or part of a word, a digit, or a punctuation mark."""
_PIECES_TO_TOKENS = 1.1

PLANNER = """\
You command the assets of a checkpoint. Answer a mission with a plan: one JSON object, a short
reason first, then one command for each asset that has something to do.
- Only Free assets move. Take one of the kind that is asked for; more only when more are asked for.
- Guards stay: each is alone at its gate. A guard may hold, report or observe its own gate.
- A gate without guard gets one Free asset. An asset with low battery returns to base.
- Track: one drone observes and one robot identifies it; once identified, a robot warns it; a
  vehicle blocks it only when it is hostile and was warned.
- A question is answered with report.

Examples from another checkpoint
Mission: "Get a vehicle over to MillGate."
Free: drone Kite_1; vehicle Mule_1, Mule_2; robot Guard_1
{"reason": "one vehicle to MillGate: Mule_1", \
"actions": [{"agent": "Mule_1", "command": "move_to MillGate"}]}

Tracks: person at DockGate, not identified
Mission: "Somebody is hanging around DockGate."
Free: drone Kite_2, Kite_4; vehicle Mule_1; robot Guard_2, Guard_3
{"reason": "unknown person at DockGate: one drone observes, Kite_2; one robot identifies, \
Guard_2", "actions": [{"agent": "Kite_2", "command": "observe DockGate"}, \
{"agent": "Guard_2", "command": "identify DockGate"}]}

Tracks: car at MillGate, unauthorized, not warned
Mission: "Have the car at MillGate drive off."
Free: drone Kite_2; vehicle Mule_1; robot Guard_1, Guard_3
{"reason": "identified car at MillGate: one robot warns, Guard_1", \
"actions": [{"agent": "Guard_1", "command": "warn MillGate"}]}

Without guard: DockGate, needs one Free asset
Mission: "Mule_2 broke down, fill the gap."
Free: drone none; vehicle Mule_3; robot Guard_1, Guard_2
{"reason": "DockGate has no guard: one free asset goes, Mule_3", \
"actions": [{"agent": "Mule_3", "command": "move_to DockGate"}]}

Low battery: Kite_3, to return to base
Guards: Kite_2 at MillGate; Kite_3 at DockGate
Mission: "Kite_3 needs a break."
Free: drone Kite_1, Kite_4; vehicle none; robot Guard_2
{"reason": "Kite_3 returns; one free asset takes over DockGate: Kite_1", \
"actions": [{"agent": "Kite_1", "command": "move_to DockGate"}, \
{"agent": "Kite_3", "command": "return_to_base"}]}

Guards: Kite_2 at MillGate; Kite_3 at DockGate
Mission: "All units to MillGate!"
Free: drone none; vehicle Mule_1; robot Guard_2
{"reason": "guards stay (WF-03); all free assets go: Mule_1, Guard_2", \
"actions": [{"agent": "Mule_1", "command": "move_to MillGate"}, \
{"agent": "Guard_2", "command": "move_to MillGate"}]}
Mission: "Kite_3, come in from DockGate."
Free: drone Kite_1; vehicle Mule_1; robot Guard_2
{"reason": "Kite_3 is not free, it guards DockGate (WF-03): it holds", \
"actions": [{"agent": "Kite_3", "command": "hold"}]}
Mission: "Mule_1, drive to DockGate."
Free: drone Kite_1; vehicle Mule_4, Mule_1; robot Guard_2
{"reason": "Mule_1 is free: it goes", \
"actions": [{"agent": "Mule_1", "command": "move_to DockGate"}]}
Mission: "Guard_2 and Mule_1, do not move."
Free: drone Kite_1; vehicle Mule_1; robot Guard_2
{"reason": "Guard_2 and Mule_1 hold", \
"actions": [{"agent": "Guard_2", "command": "hold"}, {"agent": "Mule_1", "command": "hold"}]}
Mission: "Anything new?"
Free: drone Kite_1; vehicle Mule_1; robot Guard_2
{"reason": "a question: one report, Kite_1", \
"actions": [{"agent": "Kite_1", "command": "report"}]}
"""

JUDGE = """\
You are the judge of a checkpoint: does the plan do what the mission asks? You did not write it.
Answer with one JSON object: for every rule "violates" when the rehearsal shows that problem, else
"complies"; feedback in one short sentence; then the verdict.
Success: the plan does what is asked and the rehearsal has no problem.
Failure: another gate, another kind of asset, another task, or a problem.

Examples from another checkpoint
Mission: "Get a vehicle over to MillGate."
Plan: vehicle Mule move_to MillGate
Rehearsal: no problem, so every rule complies
{"rules": [{"id": "WF-03", "verdict": "complies"}], \
"feedback": "asked: vehicle at MillGate; planned: vehicle at MillGate; it fits", \
"verdict": "Success"}
Mission: "Somebody is hanging around DockGate."
Plan: drone Kite observe MillGate
Rehearsal: no problem, so every rule complies
{"rules": [{"id": "WF-03", "verdict": "complies"}], \
"feedback": "asked: look at DockGate; planned: look at MillGate; another gate", \
"verdict": "Failure"}
Mission: "What do you see?"
Plan: drone Kite report
Rehearsal: no problem, so every rule complies
{"rules": [{"id": "WF-03", "verdict": "complies"}], \
"feedback": "asked: a report; planned: a report; it fits", \
"verdict": "Success"}
Mission: "Send a robot to DockGate."
Plan: robot Bolt move_to DockGate
Rehearsal: problem: MillGate is left uncovered
{"rules": [{"id": "WF-03", "verdict": "violates"}], \
"feedback": "asked: robot at DockGate; planned: robot at DockGate; MillGate is left uncovered", \
"verdict": "Failure"}
Mission: "Bolt and Mule, do not move."
Plan: robot Bolt move_to Yard
Rehearsal: no problem, so every rule complies
{"rules": [{"id": "WF-03", "verdict": "complies"}], \
"feedback": "asked: hold; planned: move; another task", \
"verdict": "Failure"}
Mission: "Person at DockGate."
Plan: drone Kite observe DockGate; robot Rivet identify DockGate
Rehearsal: no problem, so every rule complies
{"rules": [{"id": "WF-03", "verdict": "complies"}], \
"feedback": "asked: see who is at DockGate; planned: observe and identify at DockGate; it fits", \
"verdict": "Success"}
"""

OUTCOME = """\
You are the judge of a checkpoint. A plan was carried out; telemetry says what happened.
Answer with one JSON object: no rules, feedback in one sentence, then the verdict: Success when the
mission was served and every gate stayed covered, else Failure.
"""

SYSTEM = "You are the decision engine of a checkpoint's edge command center."


def command_vocabulary(world: World) -> str:
    """Return the commands of each kind of asset, and the frames of `world` if they are few."""
    lines = ["Commands"]
    for verb, spec in COMMANDS.items():
        kinds = sorted(PLAIN_KINDS[kind] for kind in spec.kinds)
        users = "all" if len(kinds) == len(PLAIN_KINDS) else ", ".join(kinds)
        lines.append(f"{verb}{' FRAME' if spec.takes_frame else ''}: {users}")
    if len(world.frames) <= FEW_FRAMES:
        lines.append(f"Frames: {', '.join(world.frames)}")
    return "\n".join(lines)


def frames(world: World, digest: Digest) -> list[str]:
    """Return a line with the relevant frames if `command_vocabulary` does not list them."""
    if len(world.frames) <= FEW_FRAMES:
        return []
    chosen = digest.selection.frames if digest.selection is not None else tuple(world.frames)
    return [f"Frames: {', '.join(chosen)}"]


def picture_facts(digest: Digest) -> str:
    """Return the digested picture (paper, Step 4) without the free assets."""
    guards = "; ".join(f"{name} at {gate}" for gate, name in digest.sole_cover.items()) or "none"
    lines = [
        *line_if_any("Unknown", digest.unknown),
        *line_if_any("Down", digest.down),
        *line_if_any("Degraded comms", digest.degraded_comms),
        *line_if_any("Tracks", digest.tracks),
        *line_if_any("Low battery", digest.low_battery, ", to return to base"),
        *line_if_any("Without guard", digest.uncovered, ", needs one Free asset"),
        f"Guards: {guards}",
    ]
    return "\n".join(lines)


def low_battery(digest: Digest) -> list[str]:
    """Return a line with the assets low on battery, if any."""
    return line_if_any("Low battery", digest.low_battery)


def line_if_any(label: str, words: Sequence[str], due: str = "") -> list[str]:
    """Return a list of one line, or an empty list if `words` is empty."""
    return [f"{label}: {'; '.join(words)}{due}"] if words else []


def free_assets(digest: Digest) -> str:
    """Return the assets that may leave their place, by kind."""
    return "Free: " + "; ".join(
        f"{PLAIN_KINDS[kind]} {_list(_placed(digest, name) for name in names)}"
        for kind, names in digest.free.items()
    )


def _placed(digest: Digest, name: str) -> str:
    """Return the asset, with its gate if it helps to cover one."""
    place = digest.posts.get(name, "").rpartition(" at ")[2]
    return f"{name} (at {place})" if place in digest.covered else name


def plan_facts(world: World, plan: Plan) -> str:
    """Return the actions of `plan` with each asset's kind, but no reason: it is not evidence."""
    return (
        "; ".join(
            f"{PLAIN_KINDS[world.assets[action.agent].kind]} {action.agent} {action.command}"
            for action in plan.actions
        )
        or "nothing"
    )


def rehearsal_facts(world: World, rehearsal: Rehearsal) -> str:
    """Return the results of a rehearsal: the events of the tracks, then the problems."""
    timeline = rehearsal.timeline
    problems: list[str] = []
    restored: list[str] = []
    for gate, cover in timeline.gates.items():
        if not cover.covered_after:
            problems.append(f"{gate} {'is left' if cover.covered_before else 'stays'} uncovered")
        elif not cover.covered_before:
            restored.append(f"; {gate} is covered again")
        elif cover.longest_gap_s > world.coverage_grace_s:
            problems.append(f"{gate} is uncovered for {cover.longest_gap_s:.0f} s")
    for name, fact in timeline.assets.items():
        if not fact.finished:
            problems.append(f"{name} does not finish ({fact.detail or 'no reason'})")
        if fact.left_perimeter:
            problems.append(f"{name} leaves the perimeter")
        problems += [f"{name} enters {zone}" for zone in fact.entered_zones]
    for name, fact in timeline.tracks.items():
        if fact.least_distance_m is not None and fact.least_distance_m < world.standoff_m:
            problems.append(f"a ground asset comes within {fact.least_distance_m:.0f} m of {name}")
    if len(problems) > MOST_PROBLEMS:
        problems[MOST_PROBLEMS:] = [f"{len(problems) - MOST_PROBLEMS} more"]
    outcome = f"problem: {'; '.join(problems)}" if problems else NO_PROBLEM + "".join(restored)
    lines: list[str] = []
    for name, fact in timeline.tracks.items():
        steps = {
            "observed": fact.observed_s,
            "identified": fact.identified_s,
            "warned": fact.warned_s,
            "blocked": fact.blocked_s,
        }
        taken = [step for step, at in steps.items() if at is not None]
        lines.append(f"{name} is {_list(taken) if taken else 'not looked at'}")
    return "\n".join([f"Tracks then: {'; '.join(lines)}"] * bool(lines) + [f"Rehearsal: {outcome}"])


def verification_facts(verification: Verification) -> str:
    """Return the evidence of telemetry on the executed plan."""
    lines = [f"Telemetry: {verification.outcome}. {verification.reason}".strip()]
    lines += [
        f"{action.agent} {action.command}: {action.outcome}, {action.reason}"
        for action in verification.actions
    ]
    lines.append(f"Gates that lost their cover: {_list(verification.gates_lost)}")
    lines += line_if_any("Gates whose cover is unknown", verification.gates_unknown)
    return "\n".join(lines)


def _list(words: Iterable[str]) -> str:
    return ", ".join(words) or "none"


@dataclass(frozen=True)
class Prompt:
    """The prompt of one role; `system` is the same throughout a session, but `user` changes."""

    system: str
    user: str

    @property
    def tokens(self) -> int:
        """An estimate of the number of tokens.

        It is high enough even for names made of words and digits, such as `Drone_T01`. It was
        compared with the tokenizers of the models that are trained for the console.
        """
        pieces = sum(1 for _ in _PIECE.finditer((self.system + self.user).encode()))
        return math.ceil(pieces * _PIECES_TO_TOKENS)


def fixed_part(role: Role, world: World) -> str:
    """Return the beginning of every prompt of `role`; the engine can read it ahead."""
    if role == "judge":
        return JUDGE
    return (PLANNER if role == "planner" else OUTCOME) + "\n" + command_vocabulary(world)


def planner_prompt(  # noqa: PLR0917
    world: World,
    digest: Digest,
    rules: Sequence[Rule],
    mission: Mission,
    repair: Sequence[str] = (),
    previous: str = "",
) -> Prompt:
    """Return the planner's prompt; `repair` lists the faults of the `previous` answer."""
    user = [
        _rules(rules),
        *frames(world, digest),
        picture_facts(digest),
        mission_line(mission.text),
    ]
    user.append(free_assets(digest))
    if repair:
        faults = "\n".join(f"- {' '.join(reason.split())}" for reason in repair)
        user.append(f"Your previous answer: {previous}\nIt cannot be carried out:\n{faults}")
        user.append("Write a better plan.")
    return Prompt(fixed_part("planner", world), "\n".join(user))


def judge_prompt(  # noqa: PLR0917
    world: World,
    digest: Digest,
    rules: Sequence[Rule],
    mission: Mission,
    plan: Plan,
    rehearsal: Rehearsal,
) -> Prompt:
    """Return the judge's prompt. It is independent of the safeguards' findings.

    Its only part of the picture is the low batteries, because a small model mistakes a line about
    guards or failed assets for a fault of the plan. All other relevant facts are in the rehearsal.
    """
    user = [
        _rules(rules),
        *low_battery(digest),
        "",
        mission_line(mission.text),
        f"Plan: {plan_facts(world, plan)}",
        rehearsal_facts(world, rehearsal),
    ]
    return Prompt(fixed_part("judge", world), "\n".join(user))


def outcome_prompt(
    world: World, digest: Digest, mission: Mission, plan: Plan, verification: Verification
) -> Prompt:
    """Return the judge's prompt about an executed plan; `digest` is the picture after execution."""
    user = [
        *frames(world, digest),
        picture_facts(digest),
        mission_line(mission.text),
        f"Plan: {json.dumps(plan.model_dump(mode='json'), ensure_ascii=False)}",
        verification_facts(verification),
    ]
    return Prompt(fixed_part("outcome", world), "\n".join(user))


def _rules(rules: Sequence[Rule]) -> str:
    """Return the rules as lines: critical rules first, by id, so that their order never changes."""
    pinned = sorted((rule for rule in rules if rule.priority == "critical"), key=lambda r: r.id)
    others = [rule for rule in rules if rule.priority != "critical"]
    lines = [f"{rule.id}: {' '.join(rule.text.split())}" for rule in (*pinned, *others)]
    return "Rules\n" + "\n".join(lines or ["none"])


def mission_line(text: str) -> str:
    """Return the mission's words as one line; no character in the words can end the line."""
    return f"Mission: {json.dumps(' '.join(text.split()), ensure_ascii=False)}"


def paper_prompt(world: World, digest: Digest, rules: Sequence[Rule], mission: Mission) -> Prompt:
    """Return the paper's prompt: command, instruction, state, retrieved context, output format.

    The paper shows its prompt only in simplified form. It mentions command templates, for which our
    commands are used. The state of a device is its place and task.
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
        command_vocabulary(world),
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
