"""Which agents may propose missions, how often, and how many of theirs may wait.

An agent is a program that proposes over MCP; a person decides. What an agent may never do is no
matter of this module: it has no way to approve, release or sign.
"""

import re
from collections import defaultdict, deque
from collections.abc import Callable, Collection
from time import monotonic
from unicodedata import category

from pa_console.schema.mission import Mission
from pa_console.schema.plan import MAX_REASON, Plan

MOST_A_MINUTE = 6
"""Proposals that one agent may make in a minute."""
MOST_OF_ONE, MOST_OF_ALL = 3, 8
"""Proposals of one agent, and of all together, that may be open at a time."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


class AgentDesk:
    """Admits proposals; it knows who is muted."""

    def __init__(self, muted: Collection[str] = (), clock: Callable[[], float] = monotonic) -> None:
        self.muted = set(muted)
        self._clock = clock
        self._recent: defaultdict[str, deque[float]] = defaultdict(deque)

    def admit(self, agent: str, open_missions: Collection[Mission]) -> None:
        """Count one proposal of `agent`; raises ValueError where it may not make one now.

        `open_missions` are those that wait or are worked on.
        """
        if _NAME.fullmatch(agent) is None:
            raise ValueError(f"{agent!r} is no name: letters, digits, - and _, at most 64")
        if agent in self.muted:
            raise ValueError(f"the operator has muted {agent}: it may read, and it may stop")
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
    """Raise ValueError for a text with signs that do not show, or that turn others round."""
    for text in texts:
        for sign in text:
            if category(sign).startswith("C") and sign not in "\n\r\t":
                raise ValueError(f"send plain text: U+{ord(sign):04X} does not show")


def proposed_plan(agent: str, plan: Plan) -> Plan:
    """Return `plan` with a reason that names the agent and can be read as no order."""
    return plan.model_copy(update={"reason": f"agent {agent}: {plan.reason}"[:MAX_REASON]})
