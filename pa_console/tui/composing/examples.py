"""Orders to begin with, made of the gates and assets of the world that is loaded."""

from collections.abc import Iterator
from itertools import cycle

from pa_console.schema.world import AssetKind, World

MOST = 4


def example_orders(world: World) -> tuple[str, ...]:
    """Return up to four orders, each with another gate as long as there are others.

    The assets in them are spare ones where there are any: no gate is their post.
    """
    gates = cycle(world.gates)
    orders: list[str] = []
    if drone := _spare(world, ("uav",)):
        orders.append(f"Send {drone} to look at {next(gates)}.")
    if walker := _spare(world, ("ugv", "robot")):
        orders.append(f"Send {walker} to {next(gates)}.")
    orders.append(f"Report on {next(gates)}.")
    if robot := _spare(world, ("robot", "ugv", "uav")):
        orders.append(f"Send {robot} home.")
    return tuple(orders[:MOST])


def _spare(world: World, kinds: tuple[AssetKind, ...]) -> str:
    """Return an asset of the first kind that there is; empty without any."""
    return next(_by_choice(world, kinds), "")


def _by_choice(world: World, kinds: tuple[AssetKind, ...]) -> Iterator[str]:
    for kind in kinds:
        own = [name for name, spec in world.assets.items() if spec.kind == kind]
        yield from (name for name in own if world.assets[name].post not in world.gates)
        yield from own
