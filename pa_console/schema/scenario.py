"""Scripted situations: what happens to a checkpoint, when, or on which condition."""

from collections import Counter
from collections.abc import Iterable
from typing import Annotated, Literal, Self, cast

from pydantic import Discriminator, Field, Tag, model_validator

from pa_console.schema.base import Name, NonNegative, Positive, StrictModel
from pa_console.schema.incident import Incident

TrackReach = Literal[
    "present", "detected", "observed", "identified", "warned", "stopped", "leaving", "inside",
    "gone",
]  # fmt: skip
AssetReach = Literal["moving", "arrived", "low_battery", "failed", "charging", "silent"]


class TrackIs(StrictModel):
    """True once the contact that the script named has come to a state."""

    track: Name = Field(description="the `name` given when it was spawned")
    state: TrackReach


class AssetIs(StrictModel):
    """True once an asset is in a state, at a frame if one is named."""

    asset: Name
    state: AssetReach
    at: Name | None = None


class After(StrictModel):
    """True once another scripted event has happened."""

    event: Name


def _which(value: object) -> str | None:
    """Distinguish the conditions by the field that only one of them has."""
    fields: Iterable[object] = (
        cast(dict[object, object], value)
        if isinstance(value, dict)
        else (field for field in ("track", "asset", "event") if hasattr(value, field))
    )
    return next((f"<{field}>" for field in fields if field in ("track", "asset", "event")), None)


Condition = Annotated[
    Annotated[TrackIs, Tag("<track>")]
    | Annotated[AssetIs, Tag("<asset>")]
    | Annotated[After, Tag("<event>")],
    Discriminator(
        _which,
        custom_error_type="condition",
        custom_error_message="a condition names a track, an asset or an event",
    ),
]


class ScriptedEvent(StrictModel):
    """Something that happens once: at a time, or `delay_s` after a condition first holds."""

    name: Name | None = None
    at_s: NonNegative | None = None
    when: Condition | None = None
    delay_s: NonNegative = 0.0
    do: Incident

    @model_validator(mode="after")
    def _one_trigger(self) -> Self:
        if (self.at_s is None) == (self.when is None):
            raise ValueError("give exactly one of at_s and when")
        return self


class RandomEvents(StrictModel):
    """One of `do` happens now and then: a Poisson process drawn from the simulation's seed."""

    mean_s: Positive = Field(description="mean time between two of them")
    from_s: NonNegative = 0.0
    do: tuple[Incident, ...] = Field(min_length=1)


class Scenario(StrictModel):
    """A situation for one world; the console plays it, tests and benchmarks run it."""

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9-]*$", max_length=64)
    title: str
    about: str
    duration_s: Positive = 300.0
    events: tuple[ScriptedEvent, ...] = ()
    random: tuple[RandomEvents, ...] = ()

    @model_validator(mode="after")
    def _names_exist(self) -> Self:
        names = [event.name for event in self.events if event.name is not None]
        known = frozenset(names)
        if len(known) < len(names):
            twice = min(name for name, times in Counter(names).items() if times > 1)
            raise ValueError(f"events: the name {twice!r} is given twice")
        tracks = {e.do.name for e in self.events if e.do.kind == "spawn" and e.do.name}
        for index, event in enumerate(self.events):
            match event.when:
                case After(event=name) if name not in known:
                    raise ValueError(f"events.{index}.when.event: no event is named {name!r}")
                case TrackIs(track=name) if name not in tracks:
                    raise ValueError(f"events.{index}.when.track: no spawn is named {name!r}")
                case _:
                    pass
        return self
