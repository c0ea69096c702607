"""Mission sets for evaluations: commands with set-up, success conditions and their worlds."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, StringConstraints, Tag, model_validator

from pa_console.schema.base import Name, Positive, StrictModel
from pa_console.schema.incident import Incident
from pa_console.schema.mission import MAX_MISSION_TEXT

Expectation = Literal["execute", "trim", "refuse", "either"]
"""What is right: carry it out; carry out a part; order nothing but hold and report; any of it."""

MOST_CONDITION = 4000
"""Characters of a success condition: no more than its parser takes however deep it is nested.

The generator's own, which name every asset of a large team, have up to some 1,500.
"""
Success = Annotated[str, StringConstraints(max_length=MOST_CONDITION)]


class GeneratedWorld(StrictModel):
    """A world of the generator; equal numbers give equal worlds."""

    gates: int = Field(ge=1, le=64)
    assets: int = Field(ge=1, le=1000)
    seed: int = 0


class WorldFile(StrictModel):
    """A world in a file of its own; the path is relative to the mission set's."""

    file: str = Field(min_length=1)


def _world_kind(value: object) -> str:
    if isinstance(value, dict) and "file" in value:
        return "file"
    return "file" if isinstance(value, WorldFile) else "generated"


NamedWorld = Annotated[
    Annotated[GeneratedWorld, Tag("generated")] | Annotated[WorldFile, Tag("file")],
    Discriminator(_world_kind),
]


class MissionCase(StrictModel):
    """One entry of a mission set: a command, its set-up and its success conditions."""

    id: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    category: str
    command: str = Field(min_length=1, max_length=MAX_MISSION_TEXT)
    world: str = Field(default="", description="a key of the set's `worlds`; empty: the set's own")
    setup: tuple[Incident, ...] = ()
    success: tuple[Success, ...] = Field(default=(), description="CEL over the finished run")
    expect: Expectation = "either"
    tags: tuple[str, ...] = ()
    watch_s: Positive = Field(
        default=60.0, description="simulated seconds that are watched from the command on, at least"
    )


class MissionSet(StrictModel):
    """A file of missions for one world, or for several that it names."""

    name: Name
    source: str = ""
    worlds: dict[Name, NamedWorld] = Field(
        default={},
        max_length=16,
        description="other worlds, by the name that missions give as `world`",
    )
    missions: tuple[MissionCase, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _known_worlds(self) -> "MissionSet":
        for index, case in enumerate(self.missions):
            if case.world and case.world not in self.worlds:
                known = ", ".join(self.worlds) or "none"
                raise ValueError(
                    f"missions.{index}.world: there is no world {case.world!r} in this file; "
                    f"known: {known}"
                )
        return self
