"""The actions of a plan, a row each: agent, places, duration, charge.

`Drone_T04 UAV Checkpoint → East Gate 7 s battery 97 → 95 %`. Equal actions share a row.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pa_console.schema.command import COMMANDS
from pa_console.schema.plan import Action
from pa_console.schema.telemetry import AssetTelemetry
from pa_console.tui.plan_preview.preview import PlanPreview
from pa_console.tui.status_words import BAD, QUIET, WARN
from pa_console.tui.trace.rows import Part, Row, phrased, row
from pa_console.tui.words import KIND_WORDS

_JOINED = re.compile(r"(?<=[a-z])(?=[A-Z])")


def place_words(name: str) -> str:
    """Return a frame's name as words: `EastGate` is *East Gate*."""
    return _JOINED.sub(" ", name)


@dataclass(frozen=True)
class _Deed:
    """The common part of equal actions."""

    kind: str
    way: str
    does: str
    moves: bool


def action_rows(preview: PlanPreview) -> Iterator[Row]:
    """Yield a row for each action of a rehearsed plan, one for all that are equal."""
    groups: dict[_Deed, list[Action]] = {}
    for action in preview.plan.actions:
        groups.setdefault(_deed(action, preview), []).append(action)
    for deed, actions in groups.items():
        yield _row(deed, actions, preview)


def unrehearsed_row(action: Action) -> Row:
    """Return the row of an action of a plan that could not be rehearsed."""
    return row((f"{action.agent}  ", "bold"), action.command)


def cover_row(preview: PlanPreview) -> Row | None:
    """Return which gates gain or lose guards, None where all keep theirs."""
    phrases: list[Part] = []
    for gate, change in preview.cover_changes.items():
        words = f"{place_words(gate)} {change.before} → {change.after}"
        if not change.after:
            words += ", none left"
        elif change.longest_gap_s:
            words += f", none for {change.longest_gap_s:.0f} s"
        phrases.append((words, BAD if change.loses else ""))
    return phrased(("Guards  ", QUIET), phrases) if phrases else None


def _deed(action: Action, preview: PlanPreview) -> _Deed:
    asset = preview.before.assets.get(action.agent)
    kind = KIND_WORDS[asset.kind].removeprefix("ground ") if asset is not None else "not known"
    goal, does = preview.goal(action), COMMANDS[action.verb].plainly
    if preview.is_there(action):
        stays = "holds" if action.verb == "hold" else "stays"
        way = f"{stays} {_where(asset)}" if action.verb != "report" else _where(asset)
        return _Deed(kind, way, does, moves=False)
    return _Deed(kind, f"{_from(asset)} → {place_words(goal)}", does, moves=True)


def _from(asset: AssetTelemetry | None) -> str:
    return place_words(asset.at) if asset is not None and asset.at else "under way"


def _where(asset: AssetTelemetry | None) -> str:
    if asset is None:
        return "where it is"
    if asset.at is not None:
        return f"at {place_words(asset.at)}"
    return f"on its way to {place_words(asset.post)}" if asset.post else "where it is"


def _row(deed: _Deed, actions: Sequence[Action], preview: PlanPreview) -> Row:
    names = [action.agent for action in actions]
    many = len(names) > 1
    kinds = deed.kind if deed.kind.endswith("s") else f"{deed.kind}s"
    lead = f"{len(names)} {kinds}  " if many else f"{names[0]}  "
    phrases: list[Part] = [] if many else [(deed.kind, QUIET)]
    phrases += [f"{deed.way},", deed.does] if deed.does else [deed.way]
    if deed.moves and (seconds := _seconds(names, preview)):
        phrases.append(seconds)
    phrases.append((_battery(names, preview), QUIET))
    phrases += [(why, WARN) for why in _unfinished(names, preview)]
    if many:
        phrases.append((", ".join(names), "bold"))
    return phrased((lead, "bold"), phrases)


def _seconds(names: Sequence[str], preview: PlanPreview) -> str:
    known = sorted(at for name in names if (at := preview.arrival_s(name)) is not None)
    if not known:
        return ""
    first, last = f"{known[0]:.0f}", f"{known[-1]:.0f}"
    return f"{last} s" if first == last else f"{first} to {last} s"


def _battery(names: Sequence[str], preview: PlanPreview) -> str:
    """Return the charge before and at its least meanwhile; of several the least of each."""
    lines, assets = preview.rehearsal.timeline.assets, preview.before.assets
    before = [assets[name].battery_pct for name in names if name in assets]
    least = [lines[name].least_battery_pct for name in names if name in lines]
    if not before:
        return "battery not known"
    first = f"{min(before):.0f}"
    last = f"{min(least):.0f}" if least else first
    return f"battery {first} %" if first == last else f"battery {first} → {last} %"


def _unfinished(names: Sequence[str], preview: PlanPreview) -> Iterator[str]:
    for name in names:
        line = preview.rehearsal.timeline.assets.get(name)
        if line is not None and not line.finished:
            yield f"{name}: {line.detail or 'does not finish'}"
