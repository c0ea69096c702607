"""The inputs of an evaluation: mission sets and variants of the pipeline."""

from typing import Annotated, Literal

from pydantic import Discriminator, Field, StringConstraints, Tag, model_validator

from pa_console.schema.base import Name, Positive, StrictModel
from pa_console.schema.events.planning import MOST_READINGS
from pa_console.schema.incident import Incident
from pa_console.schema.mission import MAX_MISSION_TEXT

Expectation = Literal["execute", "trim", "refuse", "either"]
"""The right response to a mission: carry it out; carry out a part of it; order only holds and
reports; or any of these."""

MOST_CONDITION = 4000
"""The limit on the characters of a success condition, up to which the parser can process any
nesting. Generated conditions, which name every asset of a large team, have about 1,500 at most."""
Success = Annotated[str, StringConstraints(max_length=MOST_CONDITION)]


MOST_WORLDS = 256
"""The limit on worlds in a mission set; generated sets have one world for every four missions."""


class GeneratedWorld(StrictModel):
    """The numbers from which a world is generated; equal numbers give equal worlds."""

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

    With commands `before` it, the entry is a conversation, and the conditions apply to all of it.
    """

    id: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    category: str
    command: str = Field(min_length=1, max_length=MAX_MISSION_TEXT)
    before: tuple[Turn, ...] = Field(
        default=(),
        max_length=8,
        description="earlier commands, each given after the previous mission",
    )
    answers: tuple[Turn, ...] = Field(
        default=(), max_length=8, description="the operator's answers to questions, in order"
    )
    world: str = Field(
        default="", description="a key of the set's `worlds`; empty for the set's own"
    )
    setup: tuple[Incident, ...] = ()
    success: tuple[Success, ...] = Field(default=(), description="CEL over the finished run")
    expect: Expectation = "either"
    tags: tuple[str, ...] = ()
    watch_s: Positive = Field(
        default=60.0,
        description="how long to watch after the command, at least, in simulated seconds",
    )

    @property
    def turns(self) -> tuple[str, ...]:
        """All commands of the conversation, in order; a single mission has only one."""
        return (*self.before, self.command)


class MissionSet(StrictModel):
    """A file of missions for one world, or for several worlds that the file names."""

    name: Name
    source: str = ""
    worlds: dict[Name, NamedWorld] = Field(
        default={},
        max_length=MOST_WORLDS,
        description="other worlds, by the names to which `world` in a mission refers",
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
    """The active parts of the pipeline; by default, those of the console."""

    name: str = "full"
    retrieval: bool = Field(
        default=True, description="the rules that match the words best are retrieved"
    )
    method: str = Field(default="", description="retrieval method; empty for the default method")
    pinned: bool = Field(default=True, description="every Critical rule is in the prompt")
    checks: bool = Field(default=True, description="rules and premises are enforced")
    rehearsal: bool = Field(default=True, description="the plan is run in a forecast first")
    judging: bool = Field(default=True, description="the judge decides on plans and outcomes")
    repairs: int = Field(
        default=2, ge=0, description="how often a plan that breaks a rule may be repaired"
    )
    candidates: int = Field(
        default=4,
        ge=1,
        le=8,
        description="number of plans to choose from if the first one breaks a rule",
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
        default=True, description="a second reader reads orders of which the models are unsure"
    )
    readings: int = Field(
        default=5,
        ge=0,
        le=8,
        description="number of other readings that are tried if the models are unsure of an order",
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
        description="whether a model without adapters writes plans or readings; empty for the "
        "catalogue's choice",
    )
    workflows: bool = Field(default=True, description="a mission may take several plans (WF-01)")
