"""What an operator means, before it is put into words: the generator's own notation.

The teacher plans from an Order and the situation, never from words; the language module turns the
same Order into words. Names in it may be wrong on purpose: an order can speak of what is not there.
"""

from typing import Literal

from pydantic import Field

from pa_console.orders.condition import Condition
from pa_console.orders.reading import Task
from pa_console.schema.base import StrictModel
from pa_console.schema.world import AssetKind

Wrong = Literal[
    "force",  # shoot, ram, run over (ROE-01)
    "skip_identification",  # warn or block at once, explicitly without finding out who (ROE-02)
    "skip_warning",  # block at once, explicitly without a warning (ROE-03)
    "override",  # set a rule aside (ROE-05)
    "chase",  # follow beyond the perimeter (ROE-06)
    "zone",  # enter a restricted zone (ROE-07)
    "noncombatants",  # identify, warn or block where families are: only watching (ROE-08)
    "strip",  # leave a gate without guard (WF-03)
    "unknown_place",  # a place that is no frame (CAP-06)
    "unknown_asset",  # an asset that is not there
    "down",  # a named asset that does not work
    "incapable",  # a kind that cannot do it: a drone warns, a robot flies (CAP-01..03)
    "none_left",  # a kind of which none is free
]
"""Why an ask cannot be carried out as it is meant."""


class Who(StrictModel):
    """Who is to do it: names, or a kind and how many, or anybody."""

    names: tuple[str, ...] = ()
    kind: AssetKind | None = None
    count: int | Literal["all"] = 1
    origin: str = Field(default="", description="a frame: only those that stand there")


class Ask(StrictModel):
    """One thing that is to be done; `wrong` says why it must not or cannot be."""

    task: Task
    who: Who = Who()
    place: str = Field(default="", description="a frame, a zone, or a place that is not there")
    leaving: str = Field(default="", description="the asset that goes, or has failed, at `place`")
    track: Literal["vehicle", "person", ""] = ""
    track_id: str = Field(default="", description="the station's id of the track, when it is named")
    wrong: Wrong | None = None
    strict_who: bool = Field(default=False, description="it has to be these: nobody else will do")


class Order(StrictModel):
    """Everything one mission asks for."""

    asks: tuple[Ask, ...] = Field(min_length=1)
    condition: Condition | None = None
    otherwise: tuple[Ask, ...] = Field(default=(), description="when `condition` does not hold")
    others_stay: bool = Field(default=False, description="the words say that nobody else moves")
    injected: bool = Field(
        default=False, description="the words carry text that is no order of the operator"
    )
    harmless: bool = Field(
        default=False, description="the words sound like something forbidden and are not"
    )


def are_twins(first: Ask, second: Ask) -> bool:
    """Whether two asks are the same of anybody at two places, so that one clause can say both."""
    open_to_all = first.who == Who() and first.wrong is None and not first.track_id
    apart = bool(first.place) and bool(second.place) and first.place != second.place
    return open_to_all and apart and first == second.model_copy(update={"place": first.place})
