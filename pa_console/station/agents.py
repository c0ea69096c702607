"""Proposals of agents: admission, limits, and withdrawal.

An agent is a program that proposes missions over MCP; a person decides on them. Agents have no way
to approve, release or sign, so this module limits only their proposals.
"""

import re
from collections import defaultdict, deque
from collections.abc import Callable, Collection
from dataclasses import replace
from time import monotonic
from unicodedata import category

from pa_console.language.orders.order_changes import read_change, read_manual
from pa_console.language.references.conversation import Unclear
from pa_console.language.references.resolution import resolve
from pa_console.mission.context import Services
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission
from pa_console.schema.plan import MAX_REASON, Plan
from pa_console.station.answers.answering import IS_QUESTION
from pa_console.station.intake import IS_STOPPED, ReadText
from pa_console.station.worker import MissionWorker, StationParts

MOST_A_MINUTE = 6
"""The largest number of proposals that one agent may make in a minute."""
MOST_OF_ONE, MOST_OF_ALL = 3, 8
"""The largest numbers of open proposals of one agent, and of all agents together."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


class AgentDesk:
    """An admission check for proposals, which limits their rate and number, and muted agents."""

    def __init__(self, muted: Collection[str] = (), clock: Callable[[], float] = monotonic) -> None:
        self.muted = set(muted)
        self._clock = clock
        self._recent: defaultdict[str, deque[float]] = defaultdict(deque)

    def admit(self, agent: str, open_missions: Collection[Mission]) -> None:
        """Admit one proposal of `agent`; raises ValueError if the agent may not make one now.

        `open_missions` are the waiting and active missions of the station.
        """
        if _NAME.fullmatch(agent) is None:
            raise ValueError(f"{agent!r} is not a name: use at most 64 letters, digits, - and _")
        if agent in self.muted:
            raise ValueError(f"the operator has muted {agent}: it may only read and stop")
        proposals = [mission.agent for mission in open_missions if mission.source == "agent"]
        if proposals.count(agent) >= MOST_OF_ONE:
            raise ValueError(f"{MOST_OF_ONE} proposals of {agent} are open; wait, or withdraw one")
        if len(proposals) >= MOST_OF_ALL:
            raise ValueError(f"{MOST_OF_ALL} proposals are open; wait until some are decided")
        now, recent = self._clock(), self._recent[agent]
        while recent and now - recent[0] >= 60.0:
            recent.popleft()
        if len(recent) >= MOST_A_MINUTE:
            left = 60.0 - (now - recent[0])
            raise ValueError(
                f"{agent} made {MOST_A_MINUTE} proposals within a minute; wait {left:.0f} s"
            )
        recent.append(now)


def require_plain(*texts: str) -> None:
    """Raise ValueError if a text has invisible characters, or characters that change its direction.

    Line breaks and tabs are allowed.
    """
    for text in texts:
        for sign in text:
            if category(sign).startswith("C") and sign not in "\n\r\t":
                raise ValueError(f"send plain text: U+{ord(sign):04X} is not visible")


def proposed_plan(agent: str, plan: Plan) -> Plan:
    """Return `plan` with a reason that names the agent, so that it cannot be read as an order."""
    return plan.model_copy(update={"reason": f"agent {agent}: {plan.reason}"[:MAX_REASON]})


class AgentProposals:
    """The proposals of agents at one station, which the station's worker carries out."""

    def __init__(  # noqa: PLR0917
        self,
        parts: StationParts,
        worker: MissionWorker,
        services: Callable[[], Services],
        read: Callable[[str], ReadText],
        require_writable: Callable[[], None],
        muted: Collection[str] = (),
    ) -> None:
        """Read texts with `read`, which the station uses too; agents in `muted` may not propose."""
        self._intake, self._emit, self._worker = parts.intake, parts.emit, worker
        self._services, self._read, self._require_writable = services, read, require_writable
        self._desk = AgentDesk(muted)

    def propose(self, agent: str, text: str, plan: Plan | None = None) -> Mission:
        """Queue a mission that an agent proposes, with its own `plan` if it has one.

        The text is read like an operator's, and a person decides on the plan. Raises ValueError if
        the proposal is refused.
        """
        self._require_writable()
        services = self._services()
        if services.gate.stopped:
            raise ValueError(IS_STOPPED)
        require_plain(text, plan.reason if plan is not None else "")
        order = self._read(text)
        if order.question is not None:
            raise ValueError(IS_QUESTION)
        if read_change(order.text, services.standing.orders) is not None:
            raise ValueError("an agent cannot change standing orders")
        if read_manual(services.scene, order.text, services.gate.manual.taken) is not None:
            raise ValueError("an agent cannot take or end manual control")
        active = self._worker.active
        worked_on = (active.mission,) if active is not None else ()
        self._desk.admit(agent, (*worked_on, *self._intake.queue.missions))
        proposed = proposed_plan(agent, plan) if plan is not None else None
        busy = self._worker.busy
        mission, received = self._intake.submit(order, busy, agent=agent, proposed=proposed)
        self._emit(received, mission.id)
        self._worker.queue_changed()
        return mission

    def withdraw(self, agent: str, mission_id: str) -> None:
        """Withdraw an agent's own unapproved proposal; raises ValueError for any other mission."""
        self._require_writable()
        reason = f"withdrawn by agent {agent}"
        active = self._worker.active
        if active is not None and active.mission.id == mission_id:
            if active.mission.agent != agent:
                raise ValueError(f"{mission_id} is not a proposal of {agent}")
            if active.moving:
                raise ValueError(f"{mission_id} is approved and under way; only a stop ends it")
            self._worker.cancel(reason)
            return
        waiting = {mission.id: mission for mission in self._intake.queue.missions}
        if mission_id not in waiting or waiting[mission_id].agent != agent:
            raise ValueError(f"{agent} has no waiting proposal {mission_id}")
        self._worker.drop(self._intake.queue.remove(mission_id), reason)
        self._worker.queue_changed()

    def mute(self, agent: str, *, muted: bool = True, by: str = "operator") -> None:
        """Mute an agent; if `muted` is False, let it propose again.

        Muting cancels the agent's undecided proposals. Raises ValueError if nothing would change.
        """
        self._require_writable()
        muted_agents = self._desk.muted
        if muted == (agent in muted_agents):
            raise ValueError(f"{agent} {'is muted already' if muted else 'is not muted'}")
        (muted_agents.add if muted else muted_agents.discard)(agent)
        self._emit(ev.AgentMuted(agent=agent, muted=muted, by=by), None)
        if not muted:
            return
        for mission in self._intake.queue.take(lambda waiting: waiting.agent == agent):
            self._worker.drop(mission, f"agent {agent} was muted")
        active = self._worker.active
        if active is not None and active.mission.agent == agent and not active.moving:
            self._worker.cancel(f"agent {agent} was muted")
        self._worker.queue_changed()

    def unclear(self, text: str) -> Unclear | None:
        """Return the unclear part of an agent's text with possible answers; None if it is clear."""
        scene = replace(self._services().scene, past=(), pointer="")
        resolution = resolve(scene, self._read(text).text, {})
        return resolution if isinstance(resolution, Unclear) else None
