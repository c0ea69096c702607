"""Loading of worlds and rules, and checks of a plan against them without a station."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime

from pa_console.fleets.fleet import Outlook
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.mission.examine import examine
from pa_console.policy.pinned_rules import RulesPins
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.finding import Finding
from pa_console.schema.mission import Mission
from pa_console.schema.plan import Plan
from pa_console.schema.world import World
from pa_console.sim.worlds.world_file import open_world
from pa_console.station import assembly
from pa_console.station.assembly import Site


def load_world(world: str = "checkpoint") -> World:
    """Return the world with an installed name, or the world in a folder or a file.

    Lengths are in metres, speeds in metres per second, times in seconds; x points east and y north.
    Raises DocumentError, a ValueError that names file, line and field.
    """
    return open_world(world)[0]


def load_rules(rules: str = "checkpoint", *, unsigned: bool = False) -> Rulebook:
    """Return the rules of an installed set or of a file, with the core, which is always in force.

    Raises DocumentError, a ValueError that names file, line and field. It is also raised for rules
    that were altered after signing, unless `unsigned` is True.
    """
    return assembly.open_rules(rules, unsigned=unsigned)[0]


def load_site(
    world: str = "checkpoint",
    rules: str = "checkpoint",
    *,
    unsigned: bool = False,
    accept_rules: bool = False,
) -> Site:
    """Return a world and the rules in force there, for `open_station`.

    As in the console, rules that are less trusted than those used before on this machine (of a
    lower version, without a signature, or from another signer) raise ValueError, unless
    `accept_rules` is True. Other errors are those of `load_world` and `load_rules`.
    """
    return assembly.load_site(
        world, rules, unsigned=unsigned, pins=RulesPins(), accept=accept_rules
    )


def check_plan(
    plan: Plan,
    rules: Rulebook,
    world: World,
    *,
    fleet: Outlook | None = None,
    mission: str = "Carry out this plan.",
) -> tuple[Finding, ...]:
    """Return the safeguards' findings on `plan` (paper, Section IV-F); no model is used.

    The plan is rehearsed in a forecast from the present picture of `fleet`; by default, from the
    initial picture of a simulation of `world`. The result has one finding for every rule, in the
    order of `rules`. If the plan cannot be started, because it names something that does not exist,
    all findings have the id PLAN. `mission` is the order, for rules about its words. No command
    reaches a device. The check takes about a second and blocks the calling thread.
    """
    given = Mission(id="check", text=mission, created=datetime.now(UTC))
    outlook = SimulatedFleet.start(world) if fleet is None else fleet
    with ThreadPoolExecutor(1) as beside_any_event_loop:
        examining = examine(plan, given, outlook, rules)
        return beside_any_event_loop.submit(asyncio.run, examining).result().findings
