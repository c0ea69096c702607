"""Plain words for things with ids: short asset names, actions as sentences, places."""

import re
from collections import Counter
from collections.abc import Iterable

from pa_console.schema.command import Verb
from pa_console.schema.plan import Action
from pa_console.schema.telemetry import Digest, Picture
from pa_console.schema.world import AssetKind

KIND_WORDS: dict[AssetKind, str] = {"uav": "UAV", "ugv": "UGV", "robot": "ground robot"}

_DEEDS: dict[Verb, str] = {
    "hold": "stops and holds where it is",
    "move_to": "moves to {target}",
    "observe": "flies to {target} and observes it",
    "identify": "goes to {target} and identifies who is there",
    "warn": "goes to {target} and warns who is there",
    "block": "drives to {target} and blocks it",
    "return_to_base": "returns to base",
    "report": "reports its status",
}
_STAYING: frozenset[Verb] = frozenset(("hold", "report"))


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Return a name of a letter and a number for each asset, e.g. `Drone_T01` -> `D1`.

    Names that would be the same get consecutive numbers instead.
    """
    names = tuple(names)
    first = {name: name[:1].upper() + _number(name) for name in names}
    counts = Counter(first.values())
    if all(_number(name) for name in names) and max(counts.values(), default=0) <= 1:
        return first
    seen: Counter[str] = Counter()
    result: dict[str, str] = {}
    for name in names:
        letter = name[:1].upper()
        seen[letter] += 1
        result[name] = f"{letter}{seen[letter]}"
    return result


def _number(name: str) -> str:
    match = re.search(r"(\d+)$", name)
    return str(int(match[1])) if match else ""


def track_names(names: Iterable[str]) -> dict[str, str]:
    """Return the number at the end of each track's name, or its place where that is not unique."""
    names = tuple(names)
    numbers = [_number(name) for name in names]
    if all(numbers) and len(set(numbers)) == len(numbers):
        return dict(zip(names, numbers, strict=True))
    return {name: str(place) for place, name in enumerate(names, start=1)}


def action_sentence(action: Action, picture: Picture | None, digest: Digest | None) -> str:
    """Say what `action` does, where its agent is now and which gate it would leave unwatched."""
    asset = picture.assets.get(action.agent) if picture else None
    who = f"{KIND_WORDS[asset.kind]} {action.agent}" if asset else f"{action.agent} (not known)"
    deed = _DEEDS[action.verb].format(target=action.target)
    where = f", now {place(asset.at, asset.post)}" if asset else ""
    return f"{who}{where}: {deed}{_loss(action, digest)}"


def _loss(action: Action, digest: Digest | None) -> str:
    if digest is None or action.verb in _STAYING:
        return ""
    left = [
        gate
        for gate, agent in digest.sole_cover.items()
        if agent == action.agent and gate != action.target
    ]
    return f"; it is the only cover of {left[0]}" if left else ""


def place(at: str | None, post: str | None) -> str:
    """Say where an asset is, or where it is heading."""
    if at is not None:
        return f"at {at}"
    return f"on its way to {post}" if post else "between frames"
