"""What an evaluation has to run: missions x models x variants x seeds, and in which worlds."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pa_console.evaluation.mission_set import load_with_worlds
from pa_console.orchestrator.compose import Site, open_world
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.mission_set import MissionCase, MissionSet
from pa_console.schema.variant import Variant
from pa_console.sim.world_generator import world_yaml

MISSION_SETS = Path("missions")


@dataclass(frozen=True)
class LoadedSet:
    """A mission set and the site of each world that its missions name."""

    missions: MissionSet
    sites: dict[str, Site]


@dataclass(frozen=True)
class Job:
    """One run to be made."""

    mission_set: str
    case: MissionCase
    site: Site
    model: str
    variant: Variant
    seed: int

    @property
    def run(self) -> str:
        """The id of the run: model/variant/set/mission/seed."""
        parts = (self.model, self.variant.name, self.mission_set, self.case.id, str(self.seed))
        return "/".join(parts)

    @property
    def stem(self) -> str:
        """The id as a file name."""
        return re.sub(r"[^A-Za-z0-9._-]+", "_", self.run.replace("/", "__"))


def mission_file(name: str, world_path: Path) -> Path:
    """Return the file of a mission set: a path, or the name of one beside the world.

    Raises ValueError with the known names when there is none.
    """
    path = Path(name)
    if path.is_file():
        return path
    folder = world_path.parent / MISSION_SETS
    beside = folder / f"{name}.yaml"
    if beside.is_file():
        return beside
    known = ", ".join(sorted(found.stem for found in folder.glob("*.yaml"))) or "none"
    raise ValueError(
        f"there is no mission set {name!r}: give the path of a file, or one of {known}"
    )


def load_set(path: Path, world: str, rulebook: Rulebook, folder: Path) -> LoadedSet:
    """Load the missions at `path`; `keep_worlds` will write generated worlds below `folder`.

    Raises DocumentError.
    """
    own, own_path = open_world(world)
    missions, worlds = load_with_worlds(path, own)
    sites = {name: Site(w, folder / name / "world.yaml", rulebook) for name, w in worlds.items()}
    return LoadedSet(missions, {**sites, "": Site(own, own_path, rulebook)})


def keep_worlds(loaded: LoadedSet) -> None:
    """Write every generated world to its site's file: a run's log is replayed with it."""
    for name, site in loaded.sites.items():
        if name:
            site.world_path.parent.mkdir(parents=True, exist_ok=True)
            site.world_path.write_text(world_yaml(site.world), encoding="utf-8")


def chosen(missions: MissionSet, only: str = "", every: int = 1) -> MissionSet | None:
    """Return the missions whose id or category contains `only`, every n-th of each category.

    None when there is no such mission.
    """
    numbers: Counter[str] = Counter()
    kept: list[MissionCase] = []
    for case in missions.missions:
        if only.lower() in case.id.lower() or only.lower() in case.category.lower():
            if numbers[case.category] % every == 0:
                kept.append(case)
            numbers[case.category] += 1
    return missions.model_copy(update={"missions": tuple(kept)}) if kept else None


def plan_jobs(
    sets: Sequence[LoadedSet],
    models: Sequence[str],
    variants: Sequence[Variant],
    seeds: Sequence[int],
) -> list[Job]:
    """Return every run, one model after the other, missions innermost."""
    return [
        Job(loaded.missions.name, case, loaded.sites[case.world], model, variant, seed)
        for model in models
        for seed in seeds
        for variant in variants
        for loaded in sets
        for case in loaded.missions.missions
    ]
