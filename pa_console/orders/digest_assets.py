"""The assets of a digest: where each stands, in what state it is, and of which the digest tells."""

from collections.abc import Iterable

from pa_console.schema.telemetry import Digest
from pa_console.schema.world import World


def asset_state(digest: Digest, name: str) -> str:
    """Return in a word or two whether an asset can be sent, as the compact picture has it."""
    if name in digest.down:
        return "down"
    guards = name in digest.sole_cover.values()
    if name in digest.low_battery:
        return "low, alone" if guards else "low"
    if guards:
        return "alone"
    return "free" if any(name in names for names in digest.free.values()) else "busy"


def standing(digest: Digest) -> dict[str, list[str]]:
    """Return who stands at each gate, and at each other frame where somebody does."""
    stands: dict[str, list[str]] = {gate: [] for gate in digest.covered}
    for name in digest.posts:
        frame = stands_at(digest, name)
        if frame:
            stands.setdefault(frame, []).append(name)
    return stands


def stands_at(digest: Digest, name: str) -> str:
    """Return the frame at which an asset stands, empty while it is on its way."""
    return digest.posts[name].partition(" at ")[2]


def told_assets(world: World, digest: Digest) -> list[str]:
    """Return the assets of which `digest` tells: of a large world, those that were selected."""
    if digest.selection is None:
        return list(world.assets)
    return [name for name in world.assets if name in digest.posts or name in digest.down]


def told_frames(world: World, digest: Digest) -> Iterable[str]:
    """Return the frames of which `digest` tells: of a large world, those that were selected."""
    if digest.selection is None:
        return world.frames
    return dict.fromkeys((*digest.covered, *digest.selection.frames))
