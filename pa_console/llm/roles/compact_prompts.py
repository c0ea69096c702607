"""The compact prompts, on which adapters are trained: facts without instructions or examples.

The parts of a prompt are, in this order, world, picture, rules and mission. World and picture can
be read ahead while the operator types; after Enter, only the retrieved rules and the mission's
words remain. In the mission's words, the operator's expressions for assets and places are replaced
by their names.
"""

from collections.abc import Iterator, Sequence

from pa_console.language.canonical.facts import asset_state, standing
from pa_console.language.name_linking import link_names
from pa_console.llm.roles.prompts import (
    FEW_FRAMES,
    Prompt,
    line_if_any,
    mission_line,
    plan_facts,
    verification_facts,
)
from pa_console.schema.events.event import Role
from pa_console.schema.mission import Mission, Verification
from pa_console.schema.plan import Plan
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.rule import Rule
from pa_console.schema.telemetry import Digest
from pa_console.schema.world import PLAIN_KINDS, World

TASKS: dict[Role, str] = {
    "planner": "Plan the mission.",
    "judge": "Judge the plan.",
    "outcome": "Judge the outcome.",
}
MOST_RULES = 2
"""The largest number of rules that are quoted; they are those that fit the mission's words best."""


def compact_fixed(role: Role, world: World) -> str:
    """Return the beginning of every compact prompt of `role` in `world`."""
    lines = [TASKS[role]]
    if len(world.frames) <= FEW_FRAMES:
        posts = [name for name, frame in world.frames.items() if frame.kind == "post"]
        lines.append(f"Gates: {', '.join(world.gates)}")
        lines.append(f"Places: {', '.join(posts) or 'none'}; base: {world.base}")
    lines.append(f"Closed: {', '.join(world.zones) or 'none'}")
    return "\n".join(lines)


def compact_picture(world: World, digest: Digest) -> str:
    """Return the digested picture (paper, Step 4); it ends with a newline.

    The facts are listed by place, by asset and by kind. Every fact follows the name that it
    concerns, because a small model finds facts after a name far better than before it. Planner and
    judge get the same text, so that both prompts can be read ahead before a mission exists.
    """
    lines = [*_places(digest), *_contacts(digest), *_assets(world, digest), *_free(digest)]
    lines += line_if_any("Unknown", digest.unknown)
    lines += digest.tracks
    return "\n".join(lines) + "\n"


def picture_prefix(role: Role, world: World, digest: Digest) -> Prompt:
    """Return the beginning of every prompt of `role` while the picture does not change."""
    return Prompt(compact_fixed(role, world), compact_picture(world, digest))


def typed_prefix(
    role: Role, world: World, digest: Digest, rules: Sequence[Rule], words: str
) -> Prompt:
    """Return the beginning of a prompt of `role` for a mission that begins with `words`.

    `rules` are the rules retrieved for `words`. If the same rules are retrieved for the whole
    mission, the model only has to read the remaining words.
    """
    start = picture_prefix(role, world, digest)
    begun = _mission(world, words).removesuffix('"')
    return Prompt(start.system, start.user + "\n".join([*_rules_held(rules), begun]))


def compact_planner_prompt(  # noqa: PLR0917
    world: World,
    digest: Digest,
    rules: Sequence[Rule],
    mission: Mission,
    repair: Sequence[str] = (),
    previous: str = "",
) -> Prompt:
    """Return the planner's prompt; `repair` lists the faults of the `previous` answer."""
    lines = [*_rules_held(rules), *_order_lines(world, mission)]
    if repair:
        lines.append(f"Previous answer: {previous}")
        lines += [f"Wrong: {' '.join(reason.split())}" for reason in repair]
    start = picture_prefix("planner", world, digest)
    return Prompt(start.system, start.user + "\n".join(lines))


def compact_judge_prompt(
    world: World,
    digest: Digest,
    rules: Sequence[Rule],
    mission: Mission,
    _plan: Plan,
    _rehearsal: Rehearsal,
) -> Prompt:
    """Return the judge's prompt, without the plan.

    A judge that sees the plan reads it into any order. Therefore, the planned actions are added
    only to the answer, after the judge's reading.
    """
    start = picture_prefix("judge", world, digest)
    lines = [*_rules_held(rules), *_order_lines(world, mission)]
    return Prompt(start.system, start.user + "\n".join(lines))


def compact_outcome_prompt(
    world: World, digest: Digest, mission: Mission, plan: Plan, verification: Verification
) -> Prompt:
    """Return the judge's prompt about an executed plan; `digest` is the picture after execution."""
    lines = [
        _mission(world, mission.text),
        f"Plan: {plan_facts(world, plan)}",
        verification_facts(verification),
    ]
    start = picture_prefix("outcome", world, digest)
    return Prompt(start.system, start.user + "\n".join(lines))


def _order_lines(world: World, mission: Mission) -> Iterator[str]:
    """Yield the mission's words; if they refer to the previous order, its commands come first."""
    if mission.follows:
        yield f"Before: {mission.follows}"
    yield _mission(world, mission.text)


def _mission(world: World, words: str) -> str:
    return mission_line(link_names(world, words))


def _places(digest: Digest) -> Iterator[str]:
    """Yield a line for each place, gates first, with its assets.

    If only one asset covers a gate, the line says so.
    """
    for frame, names in standing(digest).items():
        words = ", ".join(names) or "nobody"
        if frame in digest.uncovered:
            words += ", uncovered"
        elif frame in digest.sole_cover:
            words += f", only {digest.sole_cover[frame]} covers" if len(names) > 1 else " alone"
        yield f"{frame}: {words}"


def _contacts(digest: Digest) -> Iterator[str]:
    """Yield a line for each gate, which lists its tracks, each with its identity as one word."""
    there: dict[str, list[str]] = {gate: [] for gate in digest.covered}
    for line in digest.tracks:
        name, _, facts = line.partition(": ")
        words = facts.partition(",")[0].split()
        there.setdefault(words[-1], []).append(f"{name} {words[0]}")
    for gate, tracks in there.items():
        yield f"At {gate}: {', '.join(tracks) or 'no track'}"


def _assets(world: World, digest: Digest) -> Iterator[str]:
    """Yield a line for each asset, with its state, its kind, and its place or destination."""
    for name in (*digest.posts, *digest.down):
        kind = PLAIN_KINDS[world.assets[name].kind]
        location = digest.posts.get(name, "").partition(" ")[2]
        link = ", poor link" if name in digest.degraded_comms else ""
        yield f"{name}: {asset_state(digest, name)} {kind} {location}".rstrip() + link


def _free(digest: Digest) -> Iterator[str]:
    """Yield a line for each kind of asset, which lists its free assets, the best first.

    An asset is free if it can leave its place without uncovering a gate.
    """
    for kind, names in digest.free.items():
        yield f"Free {PLAIN_KINDS[kind]}: {', '.join(names) or 'none'}"


def _rules_held(rules: Sequence[Rule]) -> list[str]:
    """Return the retrieved rules as lines, without critical rules, which the model has learnt."""
    quoted = [rule for rule in rules if rule.priority != "critical"][:MOST_RULES]
    return [f"{rule.id}: {' '.join(rule.text.split())}" for rule in quoted]
