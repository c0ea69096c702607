"""Opens the fleet of a joined bus: simulated or real."""

from pa_console.fleets.bus.joining import Joined
from pa_console.fleets.bus.mqtt_fleet import MqttFleet
from pa_console.fleets.bus.site_fleet import SiteFleet
from pa_console.fleets.bus.trust_topics import Keys
from pa_console.fleets.vda5050.additions import SITE
from pa_console.schema.world import World


def fleet_of(
    joined: Joined, world: World, world_sha256: str, keys: Keys | None = None
) -> MqttFleet:
    """Return the fleet of `world` on the bus that was joined.

    Raises ValueError, and leaves the bus, when a site there simulates another world.
    """
    site = joined.site
    if site is None:
        return MqttFleet(world, joined, keys)
    if SITE not in joined.online:
        joined.link.close()
        raise ValueError(f"the site of {site.world!r} at {joined.link.address} is not running now")
    if site.world_sha256 != world_sha256:
        joined.link.close()
        raise ValueError(
            f"the site on this bus has another world: {site.world!r}, whose file has the "
            f"SHA-256 {site.world_sha256[:12]}; ours has {world_sha256[:12]}; give its --world"
        )
    return SiteFleet(world, joined, site, keys)
