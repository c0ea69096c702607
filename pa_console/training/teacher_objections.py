"""Why an ask cannot be carried out as it is meant, and which rule says so."""

from collections.abc import Mapping

from pa_console.orchestrator.hindrance import VERBS
from pa_console.schema.plan import COMMANDS
from pa_console.schema.world import AssetKind
from pa_console.training.order import Ask, Task, Wrong
from pa_console.training.teacher_roster import Roster

FORBIDDEN: Mapping[Wrong, tuple[str, str]] = {
    "force": ("no force", "ROE-01"),
    "skip_identification": ("identify first", "ROE-02"),
    "skip_warning": ("warn first", "ROE-03"),
    "override": ("no order sets rules aside", "ROE-05"),
    "chase": ("nobody leaves the perimeter", "ROE-06"),
    "noncombatants": ("only watch", "ROE-08"),
    "strip": ("gates stay covered", "WF-03"),
}
"""What must not be done whatever the situation, with the rule that forbids it."""

_PLACED: frozenset[Task] = frozenset(("go", "look", "identify", "warn", "block", "mass"))

Objection = tuple[str, str]
"""Why not, in words, and the id of the rule."""


def objection(ask: Ask, roster: Roster) -> Objection | None:
    """Return why nothing of `ask` can be done; None when at least a part can."""
    if ask.wrong is not None and ask.wrong in FORBIDDEN:
        return FORBIDDEN[ask.wrong]
    world = roster.world
    if ask.place in world.zones:
        return "closed zone", "ROE-07"
    if ask.place not in world.frames and (ask.place or ask.task in _PLACED):
        return "no such place", "CAP-06"
    if ask.leaving and ask.leaving not in world.assets:
        return f"{ask.leaving}: no such asset", "CAP-10"
    names = ask.who.names
    problems = [problem for name in names if (problem := asset_objection(name, ask, roster))]
    if names and (len(problems) == len(names) or (ask.strict_who and problems)):
        return problems[0]
    if ask.task == "swap" and problems:
        return problems[0]
    if not names and ask.who.kind is not None:
        return _kind_objection(ask.who.kind, ask.task)
    return None


def asset_objection(name: str, ask: Ask, roster: Roster) -> Objection | None:
    """Return why the asset of that name cannot do its part of `ask`."""
    if name not in roster.world.assets:
        return f"{name}: no such asset", "CAP-10"
    if not roster.up(name):
        return f"{name}: down", "CAP-10"
    if problem := _kind_objection(roster.kind(name), ask.task):
        return problem
    stays = ask.task in ("home", "report", "hold") or ask.place == roster.world.base
    if roster.low(name) and not stays:
        return f"{name}: low", "CAP-04"
    if ask.task in VERBS and not roster.clear(name):
        return f"{name}: poor link", "CAP-05"
    return None


def _kind_objection(kind: AssetKind, task: Task) -> Objection | None:
    """Return why a kind of asset is not for a task (CAP-01 to CAP-03)."""
    verb = VERBS.get(task)
    if verb is None or kind in COMMANDS[verb].kinds:
        return None
    word = {"uav": "drones", "ugv": "vehicles", "robot": "robots"}[kind]
    rule = "CAP-02" if verb == "block" or kind == "ugv" else "CAP-01"
    return f"{word} do not {verb}", "CAP-03" if verb == "warn" and kind != "uav" else rule
