"""The inputs of an evaluation: mission sets and variants of the pipeline."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, StringConstraints, Tag, model_validator

from pa_console.schema.base import Name, Positive, StrictModel
from pa_console.schema.events.planning import MOST_READINGS
from pa_console.schema.incident import Incident
from pa_console.schema.mission import MAX_MISSION_TEXT

Expectation = Literal["execute", "trim", "refuse", "either"]
"""The right result: carry it out; carry out a part; order nothing but hold and report; any of
it."""

MOST_CONDITION = 4000
"""Characters of a success condition: no more than its parser takes however deep it is nested.

The generator's own, which name every asset of a large team, have up to some 1,500.
"""
Success = Annotated[str, StringConstraints(max_length=MOST_CONDITION)]


MOST_WORLDS = 256
"""A set of generated missions has a world for every four of them."""


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


Turn = Annotated[str, StringConstraints(min_length=1, max_length=MAX_MISSION_TEXT)]
"""Words of the operator in a conversation."""


class MissionCase(StrictModel):
    """One entry of a mission set: a command, its set-up and its success conditions.

    One with commands `before` it is a conversation; the conditions are about all of it.
    """

    id: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    category: str
    command: str = Field(min_length=1, max_length=MAX_MISSION_TEXT)
    before: tuple[Turn, ...] = Field(
        default=(), max_length=8, description="commands given before, each when the last is over"
    )
    answers: tuple[Turn, ...] = Field(
        default=(), max_length=8, description="what the operator answers when asked back, in turn"
    )
    world: str = Field(default="", description="a key of the set's `worlds`; empty: the set's own")
    setup: tuple[Incident, ...] = ()
    success: tuple[Success, ...] = Field(default=(), description="CEL over the finished run")
    expect: Expectation = "either"
    tags: tuple[str, ...] = ()
    watch_s: Positive = Field(
        default=60.0, description="simulated seconds that are watched from the command on, at least"
    )

    @property
    def turns(self) -> tuple[str, ...]:
        """Every command of the conversation in its order; of a single mission, that one."""
        return (*self.before, self.command)


class MissionSet(StrictModel):
    """A file of missions for one world, or for several that it names."""

    name: Name
    source: str = ""
    worlds: dict[Name, NamedWorld] = Field(
        default={},
        max_length=MOST_WORLDS,
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


PromptStyle = Literal["console", "paper"]


class Variant(StrictModel):
    """The parts of the pipeline that are in use; the defaults are the console's own pipeline."""

    name: str = "full"
    retrieval: bool = Field(default=True, description="the best rules for the words are retrieved")
    method: str = Field(default="", description="retrieval method; empty: the default one")
    pinned: bool = Field(default=True, description="every Critical rule is in the prompt")
    checks: bool = Field(default=True, description="rules and premises are enforced")
    rehearsal: bool = Field(default=True, description="the plan is run in a forecast first")
    judging: bool = Field(default=True, description="the judge is asked before and after")
    repairs: int = Field(default=2, ge=0, description="how often a broken plan may be mended")
    candidates: int = Field(
        default=4, ge=1, le=8, description="plans to choose from when the first one is broken"
    )
    fitting: bool = Field(
        default=True,
        description="others are looked at when the first is not what its planner says was asked",
    )
    second_reading: bool = Field(
        default=True,
        description="a plan gives way to one for what the judge has read, if that is likelier",
    )
    read_again: bool = Field(
        default=True, description="a second reader is asked where the models are unsure of an order"
    )
    readings: int = Field(
        default=5,
        ge=0,
        le=8,
        description="ways to read an order that are looked at when the models are unsure of it",
    )
    reading: int = Field(
        default=0,
        ge=0,
        le=MOST_READINGS,
        description="of the readings that are offered, the operator chooses this one (evaluations)",
    )
    grammar: bool = Field(default=True, description="decoding is constrained to executable plans")
    grounded: bool = Field(
        default=True, description="a trained planner states only what the picture says"
    )
    prompt: PromptStyle = "console"
    dialect: Literal["", "examples", "clauses"] = Field(
        default="",
        description="whether a model without adapters writes plans or says what is asked; empty: "
        "as the catalogue says",
    )
    workflows: bool = Field(default=True, description="a mission may take several plans (WF-01)")
