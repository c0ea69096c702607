"""The remains of a relieved station's session: waiting missions, running missions, a stop.

A mission that has not moved any asset is queued again with its original text, planned with the
vehicles' present reports, and takes an approval as any mission does. A mission that has sent a
command is only reported: its plan was approved for another station. Alarms are raised anew by the
picture, and with them the missions that answer them; standing orders were approved at that station
alone.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from pa_console.schema.mission import Mission
from pa_console.session.state.fold import SessionState, begun_missions, waiting_entries
from pa_console.session.state.mission_trace import MissionTrace
from pa_console.session.wording import order_in_words


@dataclass(frozen=True)
class LeftMissions:
    """The remains of a relieved station's session.

    `again` are the missions that moved no asset, the one that was being planned first; `under_way`
    those that did; `standing` the ids of the standing orders in force there; `stopped` is whether
    all assets were stopped.
    """

    again: tuple[Mission, ...] = ()
    under_way: tuple[MissionTrace, ...] = ()
    standing: tuple[str, ...] = ()
    stopped: bool = False

    @classmethod
    def of(cls, state: SessionState) -> "LeftMissions":
        """Return what the session `state` leaves as it stands; of one that has ended nothing."""
        if state.ended:
            return cls()
        begun = begun_missions(state)
        again = [trace.mission for trace in begun if not trace.commands]
        again += [entry.mission for entry in waiting_entries(state)]
        return cls(
            again=tuple(one for one in again if one.source == "operator"),
            under_way=tuple(trace for trace in begun if trace.commands),
            standing=tuple(name for name, one in state.standing.items() if one.in_force),
            stopped=state.stop is not None,
        )

    def notices(self, station: str) -> Iterator[str]:
        """Yield what an operator has to know of it, as lines; `station` is who was relieved."""
        for trace in self.under_way:
            sent = "; ".join(
                f"{one.command.agent} {order_in_words(one.command)}"
                for one in trace.commands.values()
            )
            yield (
                f"{station} had {trace.mission.id} “{trace.mission.said}” under way ({sent}): "
                "vehicles end what they have begun, and nobody verifies it"
            )
        if self.standing:
            yield (
                f"no standing order of {station} is in force here ({', '.join(self.standing)}): "
                "approve them anew"
            )
        if self.stopped:
            yield f"{station} had stopped everybody: they stay stopped until you release them"
