"""The jobs of an evaluation (missions x models x variants x seeds), and their worlds."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field, RootModel

from pa_console.evaluation.score import compile_condition
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document
from pa_console.schema.evaluation import MissionCase, MissionSet, Variant, WorldFile
from pa_console.schema.incident import unknown_name
from pa_console.schema.world import World
from pa_console.sim.worlds.world_file import load_world, open_world
from pa_console.sim.worlds.world_generator import generate_world, world_yaml
from pa_console.station.assembly import Site

MISSION_SETS = Path("missions")
REFERENCE = "one-plan"
"""The reference of the ablations, which is the complete pipeline with one plan per mission."""


class _VariantEntry(StrictModel):
    """An entry of `variants.yaml`."""

    about: str
    settings: dict[str, bool | int | str] = Field(default_factory=dict[str, bool | int | str])


class _Variants(RootModel[dict[str, _VariantEntry]]):
    """The file `variants.yaml`."""


_ENTRIES = Document.read(Path(__file__).with_name("variants.yaml")).parse(_Variants).root

ABOUT = {name: entry.about for name, entry in _ENTRIES.items()}
"""The description of each variant, in the order of the tables."""

VARIANTS = {
    name: Variant.model_validate({"name": name, **entry.settings})
    for name, entry in _ENTRIES.items()
}


def load_missions(path: Path, world: World) -> MissionSet:
    """Return the missions at `path` for `world`; raises DocumentError with file, line and field."""
    return load_with_worlds(path, world)[0]


def load_with_worlds(path: Path, world: World) -> tuple[MissionSet, dict[str, World]]:
    """Return the missions at `path`, and the worlds that they name; the name "" means `world`.

    Raises DocumentError with file, line and field. Ids must be unique. A set-up may name only
    assets, frames and gates of the mission's world. A success condition may name only fields and
    values that a run in that world can have.
    """
    document = Document.read(path)
    missions = document.parse(MissionSet)
    worlds = {"": world}
    for name, made in missions.worlds.items():
        try:
            if isinstance(made, WorldFile):
                worlds[name] = load_world(path.parent / made.file)
            else:
                worlds[name] = generate_world(made.gates, made.assets, made.seed)
        except ValueError as error:
            raise document.error(("worlds", name), str(error)) from error
    seen: set[str] = set()
    for index, case in enumerate(missions.missions):
        if case.id in seen:
            raise document.error(("missions", index, "id"), f"{case.id!r} appears twice")
        seen.add(case.id)
        for number, incident in enumerate(case.setup):
            field, remedy = unknown_name(incident, worlds[case.world])
            if field:
                raise document.error(("missions", index, "setup", number, field), remedy)
        for number, source in enumerate(case.success):
            try:
                compile_condition(source, worlds[case.world])
            except ValueError as error:
                raise document.error(("missions", index, "success", number), str(error)) from error
    return missions, worlds


def find_variant(name: str) -> Variant:
    """Return the variant called `name`; raises ValueError with the known names if none has it."""
    if name not in VARIANTS:
        raise ValueError(f"unknown variant {name!r}; known: {', '.join(VARIANTS)}")
    return VARIANTS[name]


@dataclass(frozen=True)
class LoadedSet:
    """A mission set, and the site of each of its worlds."""

    missions: MissionSet
    sites: dict[str, Site]


@dataclass(frozen=True)
class Job:
    """One run of an evaluation."""

    mission_set: str
    case: MissionCase
    site: Site
    model: str
    variant: Variant
    seed: int

    @property
    def run(self) -> str:
        """The id of the run, in the form model/variant/set/mission/seed."""
        parts = (self.model, self.variant.name, self.mission_set, self.case.id, str(self.seed))
        return "/".join(parts)

    @property
    def stem(self) -> str:
        """The id as a file name."""
        return re.sub(r"[^A-Za-z0-9._-]+", "_", self.run.replace("/", "__"))


def mission_file(name: str, world_path: Path) -> Path:
    """Return the file of a mission set, given as a path or as the name of a set beside the world.

    Raises ValueError with the known names if there is no such file.
    """
    path = Path(name)
    if path.is_file():
        return path
    folder = world_path.parent / MISSION_SETS
    beside = folder / f"{name}.yaml"
    if beside.is_file():
        return beside
    names = ", ".join(sorted(path.stem for path in folder.glob("*.yaml"))) or "none"
    raise ValueError(
        f"there is no mission set {name!r}: give the path of a file, or one of {names}"
    )


def load_set(
    path: Path, world: str, rulebook: Rulebook, folder: Path, rules_path: Path | None = None
) -> LoadedSet:
    """Return the missions at `path` with their sites; raises DocumentError if not valid.

    `keep_worlds` writes generated worlds to paths below `folder`. `rules_path` is the file of the
    rulebook, which a sweep sends to its workers.
    """
    own, own_path = open_world(world)
    missions, worlds = load_with_worlds(path, own)
    sites = {
        name: Site(made, folder / name / "world.yaml", rulebook, rules_path)
        for name, made in worlds.items()
    }
    return LoadedSet(missions, {**sites, "": Site(own, own_path, rulebook, rules_path)})


def keep_worlds(loaded: LoadedSet) -> None:
    """Write every generated world to its site's file, because replays of the logs need it."""
    for name, site in loaded.sites.items():
        if name:
            site.world_path.parent.mkdir(parents=True, exist_ok=True)
            site.world_path.write_text(world_yaml(site.world), encoding="utf-8")


def chosen_missions(missions: MissionSet, only: str = "", every: int = 1) -> MissionSet | None:
    """Return the missions whose id or category contains `only`, one of `every` in each category.

    Returns None if there is no such mission.
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
    """Return a job for each run, ordered by model, seed, variant and mission."""
    return [
        Job(loaded.missions.name, case, loaded.sites[case.world], model, variant, seed)
        for model in models
        for seed in seeds
        for variant in variants
        for loaded in sets
        for case in loaded.missions.missions
    ]
