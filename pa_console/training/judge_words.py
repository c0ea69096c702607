"""How one plan differs from another in what it does."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

from pa_console.schema.plan import Action, Verb
from pa_console.schema.world import World

STILL: frozenset[Verb] = frozenset(("hold", "report"))


@dataclass
class Difference:
    """What is right and not planned, what is planned and not right, and what is done by others.

    Pairs are of an action that is right and the one that stands in its place. `alike` are pairs
    that come to the same unless the order says who; `others` have an asset that is not meant,
    `places` and `steps` the right asset at another place or with another task.
    """

    missing: list[Action] = field(default_factory=list[Action])
    extra: list[Action] = field(default_factory=list[Action])
    alike: list[tuple[Action, Action]] = field(default_factory=list[tuple[Action, Action]])
    others: list[tuple[Action, Action]] = field(default_factory=list[tuple[Action, Action]])
    places: list[tuple[Action, Action]] = field(default_factory=list[tuple[Action, Action]])
    steps: list[tuple[Action, Action]] = field(default_factory=list[tuple[Action, Action]])

    @property
    def size(self) -> int:
        """How much differs that matters."""
        pairs = len(self.others) + len(self.places) + len(self.steps)
        return 2 * (len(self.missing) + len(self.extra)) + pairs


def difference(
    right: Sequence[Action], plan: Sequence[Action], named: Collection[str], world: World
) -> Difference:
    """Return how `plan` differs from the `right` actions; assets that are `named` are meant.

    Flying somewhere and watching there count as the same, as do all ways back to the base.
    """
    found = Difference()
    wanted, given = list(right), list(plan)

    def pair(into: list[tuple[Action, Action]] | None, tests: Collection[str]) -> None:
        for one in list(wanted):
            for other in given:
                if _agree(one, other, tests, world):
                    wanted.remove(one)
                    given.remove(other)
                    if into is not None:
                        into.append((one, other))
                    break

    pair(None, ("agent", "effect"))
    for one in list(wanted):
        for other in given:
            free = one.agent not in named and other.agent not in named
            if free and _agree(one, other, ("kind", "effect"), world):
                wanted.remove(one)
                given.remove(other)
                found.alike.append((one, other))
                break
    pair(found.others, ("effect",))
    pair(found.places, ("agent", "verb"))
    pair(found.places, ("kind", "verb"))
    pair(found.steps, ("agent", "place"))
    pair(found.steps, ("kind", "place"))
    found.missing, found.extra = wanted, given
    return found


def _agree(one: Action, other: Action, tests: Collection[str], world: World) -> bool:
    """Whether two actions agree in everything that `tests` name."""
    effect, effect2 = _effect(one, world), _effect(other, world)
    agreements = {
        "agent": one.agent == other.agent,
        "kind": world.assets[one.agent].kind == world.assets[other.agent].kind,
        "effect": effect == effect2,
        "verb": effect[0] == effect2[0] and effect[1] != "",
        "place": effect[1] == effect2[1] and effect[1] != "",
    }
    return all(agreements[test] for test in tests)


def _effect(action: Action, world: World) -> tuple[str, str]:
    """Return what an action comes to: a place where the asset will be, or a verb with its place."""
    match action.verb:
        case "return_to_base":
            return "at", world.base
        case "move_to" | "observe":
            return "at", action.target or ""
        case verb:
            return verb, action.target or ""
