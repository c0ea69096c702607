"""Writes generated missions in generated worlds as a mission set that evaluations can run."""

from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import NamedTuple

import yaml

from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.schema.evaluation import MissionCase, MissionSet, NamedWorld, WorldFile
from pa_console.schema.world import World
from pa_console.sim.worlds.world_generator import world_yaml
from pa_training.proof.verify import verify
from pa_training.samples.data_set import drop_known, each_in_order
from pa_training.samples.planner_samples import Group, Proven, Recipe, make_group
from pa_training.situations.situations import Situation, settled
from pa_training.situations.worlds import (
    Numbers,
    Split,
    generated_numbers,
    shipped_missions,
)

PER_WORLD = 4
MOST_FRUITLESS = 8
"""So many worlds in a row may give no mission; in more there is something wrong with the rules."""
SIMULATION_SEEDS = (0, 1, 2)
"""Seeds for which the plan has to be right: evaluations begin with them."""


class _Task(NamedTuple):
    recipe: Recipe
    rules: Path
    forbidden: frozenset[Numbers]


@dataclass
class Found:
    """The missions of one world; `dropped` counts those that were not taken."""

    world: World
    cases: list[MissionCase] = field(default_factory=list[MissionCase])
    dropped: int = 0


def generated_missions(
    wanted: int, seed: int, split: Split, rules: Path, processes: int
) -> Generator[Found, None, None]:
    """Yield worlds with missions in them until there are `wanted` missions.

    Every mission has a plan that was proven right from the set-up alone, and is unlike those of the
    shipped sets. Equal arguments give equal missions, however many `processes` there are. Raises
    DocumentError for a broken rule file, and ValueError when no missions can be made.
    """
    forbidden = generated_numbers(shipped_missions())
    made = number = fruitless = 0
    while made < wanted:
        groups, before = -(-(wanted - made) // PER_WORLD), made
        tasks = [
            _Task(Recipe(number + extra, seed, PER_WORLD, split, history=False), rules, forbidden)
            for extra in range(groups)
        ]
        number += groups
        with closing(each_in_order(_find, tasks, processes)) as worlds:
            for found in worlds:
                kept = found.cases[: wanted - made]
                made += len(kept)
                if kept:
                    yield Found(found.world, kept, found.dropped)
        fruitless = fruitless + groups if made == before else 0
        if fruitless >= MOST_FRUITLESS:
            raise ValueError(f"{rules}: {fruitless} worlds gave no mission that could be proven")


def write_mission_set(file: Path, name: str, source: str, found: Sequence[Found]) -> MissionSet:
    """Write the missions to `file`, their worlds into the folder `<stem>-worlds` beside it.

    Equal worlds share a file. Raises OSError.
    """
    folder = file.with_name(f"{file.stem}-worlds")
    folder.mkdir(parents=True, exist_ok=True)
    worlds: dict[str, str] = {}
    cases: list[MissionCase] = []
    for part in found:
        text = world_yaml(part.world)
        world = worlds.setdefault(text, f"w{len(worlds):03d}")
        for case in part.cases:
            cases.append(case.model_copy(update={"id": f"G{len(cases):03d}", "world": world}))
    for text, world in worlds.items():
        (folder / f"{world}.yaml").write_text(text, encoding="utf-8")
    files: dict[str, NamedWorld] = {
        world: WorldFile(file=f"{folder.name}/{world}.yaml") for world in worlds.values()
    }
    missions = MissionSet(name=name, source=source, worlds=files, missions=tuple(cases))
    file.write_text(_mission_set_yaml(missions), encoding="utf-8")
    return missions


def _find(task: _Task) -> Found:
    """Return the missions of one world that are right whatever the simulation's seed."""
    rulebook = _rulebook(task.rules)
    group = make_group(task.recipe, rulebook, task.forbidden)
    drop_known(group)
    kept = [_tagged(proven) for proven in group.proven if _robust(proven, group, rulebook)]
    return Found(group.situation.world, kept, group.dropped.total() + len(group.proven) - len(kept))


def _robust(proven: Proven, group: Group, rulebook: Rulebook) -> bool:
    """Return whether words and plan are right under every seed that evaluations begin with.

    An order may speak of a track, which must not be at another gate then.
    """
    there = group.situation
    tracks = dict(_tracks(there))
    for seed in SIMULATION_SEEDS:
        try:
            situation = settled(there.world, seed, there.setup, like=there.sim)
        except ValueError:  # the set-up finds no room with this seed
            return False
        if any(gate != tracks.get(name, gate) for name, gate in _tracks(situation)):
            return False
        follow = proven.target.follow
        if not verify(proven.case, situation, proven.plan, rulebook, follow=follow).right:
            return False
    return True


def _tracks(situation: Situation) -> Iterator[tuple[str, str]]:
    """Yield every track in sight with its gate."""
    return ((name, track.gate) for name, track in situation.picture.tracks.items())


def _tagged(proven: Proven) -> MissionCase:
    """Return the case with its kind, and how it is worded, as tags."""
    kind, _, style = proven.kind.rpartition("/")
    marks = {"harmless": proven.order.harmless, "injected": proven.order.injected}
    tags = (kind, style, *(mark for mark, there in marks.items() if there))
    return proven.case.model_copy(update={"tags": tuple(dict.fromkeys(filter(None, tags)))})


def _mission_set_yaml(missions: MissionSet) -> str:
    """Return `missions` as the text of a file that reads back equal."""
    document = missions.model_dump(mode="json", exclude_defaults=True)
    for written, case in zip(document["missions"], missions.missions, strict=True):
        if case.setup:
            written["setup"] = [
                {"kind": incident.kind} | incident.model_dump(mode="json", exclude_defaults=True)
                for incident in case.setup
            ]
    return yaml.safe_dump(document, sort_keys=False, width=100, allow_unicode=True)


@cache
def _rulebook(rules: Path) -> Rulebook:
    return load_rules(rules)
