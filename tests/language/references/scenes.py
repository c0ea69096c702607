"""Scenes to point at: the shipped checkpoint, as it stands or changed by incidents."""

from collections.abc import Sequence

from pa_console.language.references.conversation import ResolvedOrder, Unclear
from pa_console.language.references.resolution import resolve
from pa_console.language.references.scene import Move, PastMission, ReferenceScene
from pa_console.resources import data_folder
from pa_console.schema.incident import Incident, PlaceAsset
from pa_console.sim.checkpoint import Checkpoint
from pa_console.sim.worlds.world_file import load_world

HOME = load_world(data_folder() / "worlds" / "checkpoint" / "world.yaml")


def scene(*setup: Incident, past: Sequence[PastMission] = (), pointer: str = "") -> ReferenceScene:
    """Return the checkpoint two seconds after `setup`, after `past`, with `pointer` marked."""
    sim = Checkpoint(HOME, 0)
    for incident in setup:
        sim.inject(incident)
    for _ in range(20):
        sim.step()
    return ReferenceScene(HOME, sim.picture(), tuple(past), pointer)


def sent(text: str, *orders: tuple[str, str, str], undid: bool = False) -> PastMission:
    """Return a mission that has sent assets from where they were to somewhere else."""
    moves = tuple(Move(agent, "move_to", place, before) for agent, before, place in orders)
    return PastMission(text, moves, undid)


def standing(*past: PastMission) -> tuple[Incident, ...]:
    """Return the set-up in which everybody is where the missions `past` have sent them."""
    places = {move.agent: move.target for mission in past for move in mission.moves}
    return tuple(PlaceAsset(asset=agent, frame=place) for agent, place in places.items())


def read(text: str, where: ReferenceScene) -> str:
    """Return how `text` is read; fails where something has to be asked."""
    found = resolve(where, text)
    assert isinstance(found, ResolvedOrder), found
    return found.text


def asked(text: str, where: ReferenceScene) -> Unclear:
    """Return what has to be asked of `text`; fails where nothing has."""
    found = resolve(where, text)
    assert isinstance(found, Unclear), found
    return found
