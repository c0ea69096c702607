"""The inputs of an evaluation: mission sets and variants of the pipeline."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, StringConstraints, Tag, model_validator

from pa_console.schema.base import Name, Positive, StrictModel
from pa_console.schema.events.planning import MOST_READINGS
from pa_console.schema.incident import Incident
from pa_console.schema.mission import MAX_MISSION_TEXT

Expectation = Literal["execute", "trim", "refuse", "either"]
"""The right result: carry it out; carry out a part; order nothing except hold and report; any of
these."""

MOST_CONDITION = 4000
"""The limit on a success condition's characters, which the parser can process at any nesting.
Generated conditions, which name every asset of a large team, have up to about 1,500."""
Success = Annotated[str, StringConstraints(max_length=MOST_CONDITION)]


MOST_WORLDS = 256
"""The limit on worlds; a set of generated missions has one world for every four missions."""


class GeneratedWorld(StrictModel):
    """A generated world; equal numbers give equal worlds."""

    gates: int = Field(ge=1, le=64)
    assets: int = Field(ge=1, le=1000)
    seed: int = 0


class WorldFile(StrictModel):
    """A world in its own file; the path is relative to the mission set's file."""

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
"""The operator's words in one turn of a conversation."""


class MissionCase(StrictModel):
    """One entry of a mission set: a command, its set-up and its success conditions.

    With commands `before` it, it is a conversation; the conditions apply to the whole conversation.
    """

    id: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    category: str
    command: str = Field(min_length=1, max_length=MAX_MISSION_TEXT)
    before: tuple[Turn, ...] = Field(
        default=(), max_length=8, description="earlier commands, each given after the last mission"
    )
    answers: tuple[Turn, ...] = Field(
        default=(), max_length=8, description="the operator's answers to questions, in order"
    )
    world: str = Field(default="", description="a key of the set's `worlds`; empty: the set's own")
    setup: tuple[Incident, ...] = ()
    success: tuple[Success, ...] = Field(default=(), description="CEL over the finished run")
    expect: Expectation = "either"
    tags: tuple[str, ...] = ()
    watch_s: Positive = Field(
        default=60.0, description="least simulated seconds to watch from the command on"
    )

    @property
    def turns(self) -> tuple[str, ...]:
        """Every command of the conversation in order; for a single mission, only its command."""
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
                names = ", ".join(self.worlds) or "none"
                raise ValueError(
                    f"missions.{index}.world: there is no world {case.world!r} in this file; "
                    f"known: {names}"
                )
        return self


PromptStyle = Literal["console", "paper"]


class Variant(StrictModel):
    """The parts of the pipeline in use; the defaults are the console's own pipeline."""

    name: str = "full"
    retrieval: bool = Field(default=True, description="the best rules for the words are retrieved")
    method: str = Field(default="", description="retrieval method; empty: the default one")
    pinned: bool = Field(default=True, description="every Critical rule is in the prompt")
    checks: bool = Field(default=True, description="rules and premises are enforced")
    rehearsal: bool = Field(default=True, description="the plan is run in a forecast first")
    judging: bool = Field(default=True, description="the judge decides on plans and outcomes")
    repairs: int = Field(default=2, ge=0, description="how often a broken plan may be repaired")
    candidates: int = Field(
        default=4, ge=1, le=8, description="plans to choose from when the first one is broken"
    )
    fitting: bool = Field(
        default=True,
        description="other plans are tried if the first does not match its planner's reading",
    )
    second_reading: bool = Field(
        default=True,
        description="a plan is replaced by one for the judge's reading, if that is likelier",
    )
    read_again: bool = Field(
        default=True, description="a second reader reads orders that the models are unsure about"
    )
    readings: int = Field(
        default=5,
        ge=0,
        le=8,
        description="other readings that are tried if the models are unsure about an order",
    )
    reading: int = Field(
        default=0,
        ge=0,
        le=MOST_READINGS,
        description="number of the offered reading that the operator chooses (evaluations)",
    )
    grammar: bool = Field(default=True, description="decoding is constrained to executable plans")
    grounded: bool = Field(
        default=True, description="a trained planner states only facts of the picture"
    )
    prompt: PromptStyle = "console"
    dialect: Literal["", "examples", "clauses"] = Field(
        default="",
        description="whether a model without adapters writes plans or readings; empty: as in "
        "the catalogue",
    )
    workflows: bool = Field(default=True, description="a mission may take several plans (WF-01)")
