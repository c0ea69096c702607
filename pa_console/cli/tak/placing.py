"""Puts a world where it is on the earth, by an option or by its own file."""

from pa_console.schema.world import World
from pa_console.tak.site_on_map import Geography, SiteOnMap, origin_of


def placed(world: World, origin: str, name: str = "", *, replay: bool = False) -> SiteOnMap:
    """Return the site that is called `name`, else as the world; `origin` goes before its file.

    Raises ValueError for an origin or a name that is none, and for a world that is nowhere.
    """
    at = origin_of(origin) if origin else world.origin
    if at is None:
        raise ValueError(
            f"the world {world.name!r} does not say where on the earth it is: give its origin as "
            "LATITUDE,LONGITUDE (--origin, --tak-origin), or 'origin' in its file"
        )
    return SiteOnMap(world, Geography(at), name or world.name, replay)
