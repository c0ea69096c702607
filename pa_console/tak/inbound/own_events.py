"""Tells what this console has sent itself from what somebody else sends under its names."""

from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

from pa_console.schema.events.tak import MOST_CALLSIGN
from pa_console.tak.cot_event import DELETE, CotEvent
from pa_console.tak.inbound.heard_event import HeardEvent
from pa_console.tak.site_on_map import SiteOnMap

KEPT = 30
"""So many events of a thing are remembered: a server may send the last ones back."""
MOST_THINGS = 10_000
SAME = timedelta(milliseconds=20)
"""How far two times may be apart that a server has written anew."""
ROUNDED = 2e-6
"""How far two angles may be apart likewise, in degrees."""


@dataclass(frozen=True)
class _Sent:
    type: str
    time: datetime
    stale: datetime
    latitude: float
    longitude: float
    callsign: str


class OwnEvents:
    """Remembers what was sent; each uid of the site is the site's alone."""

    def __init__(
        self, site: SiteOnMap, now: Callable[[], datetime] = lambda: datetime.now(UTC)
    ) -> None:
        """What was told before this moment may be from an earlier session of the site."""
        self._prefix = site.uid("")
        self._prefixes = self._prefix, replace(site, replay=True).uid("")
        self._begun, self._lasts = now(), timedelta(seconds=site.world.stale_s)
        self._sent: OrderedDict[str, deque[_Sent]] = OrderedDict()

    def sent(self, event: CotEvent) -> None:
        """Note that `event` is about to be sent."""
        if not (event.type.startswith("a-") or event.type == DELETE):
            return
        subject, at = event.subject, event.point
        callsign = next((e.get("callsign", "") for e in event.detail if e.tag == "contact"), "")
        known = self._sent.pop(subject, None)
        self._sent[subject] = known if known is not None else deque[_Sent](maxlen=KEPT)
        self._sent[subject].append(
            _Sent(
                event.type,
                event.time,
                event.stale,
                at.latitude,
                at.longitude,
                callsign[:MOST_CALLSIGN],
            )
        )
        if len(self._sent) > MOST_THINGS:
            self._sent.popitem(last=False)

    def holds(self, uid: str) -> bool:
        """Whether `uid` is one of this site, live or in a replay."""
        return uid.startswith(self._prefixes)

    def impostor(self, heard: HeardEvent) -> str:
        """Return the name of ours under which somebody else speaks in `heard`, '' for none.

        Drawings are not looked at: only who says where something is, or takes it off the map.
        """
        if not heard.subject.startswith(self._prefix) or not (heard.places or heard.type == DELETE):
            return ""
        if any(_is_same(sent, heard) for sent in self._sent.get(heard.subject, ())):
            return ""
        if heard.time < self._begun and heard.stale - heard.time <= self._lasts + SAME:
            return ""
        return heard.subject.removeprefix(self._prefix)


def _is_same(sent: _Sent, heard: HeardEvent) -> bool:
    """Whether a server has sent an event back; it may have shortened how long it holds."""
    return (
        sent.type == heard.type
        and abs(sent.time - heard.time) <= SAME
        and heard.stale <= sent.stale + SAME
        and abs(sent.latitude - heard.latitude) <= ROUNDED
        and abs(sent.longitude - heard.longitude) <= ROUNDED
        and sent.callsign == heard.callsign
    )
