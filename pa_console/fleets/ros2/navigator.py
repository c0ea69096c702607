"""The goals of one robot: its orders, its answers, and the outcome of each order.

An order is a goal of Nav2's action `NavigateToPose`. The id of the goal is derived from the id of
the command. No goal is sent twice, because action servers in C++ end with an exception if a known
id arrives again (rclcpp_action, "Failed to accept new goal"). If the answer to a goal is missing,
its result is requested.
"""

import math
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from pa_console.fleets.link import DeviceAnswer
from pa_console.fleets.ros2.connection import RobotEntry, RobotSite
from pa_console.fleets.ros2.messages import ACTIVE, CANCELED, SUCCEEDED, UNKNOWN, Planar
from pa_console.schema.base import Point
from pa_console.schema.command import (
    ADDRESSING,
    COMMANDS,
    FINAL_REPLIES,
    DeviceCommand,
    ReplyStatus,
)
from pa_console.schema.telemetry import Task

if TYPE_CHECKING:
    from pa_console.fleets.ros2.node import Nav2Server

ARRIVED_S = 2.0
"""The time within which a robot's pose must confirm its reported arrival, in seconds."""

STANDS_MPS = 0.05
"""The speed up to which a robot counts as stopped, because measured speeds are never quite zero."""

MOST_GOALS = 256
"""The number of recent orders of a robot whose answers can be repeated."""

HELD = "stopped by a hold"


class Seen(NamedTuple):
    """The place of a robot in the world, its speed, and the monotonic time of arrival of both."""

    at: Point
    speed_mps: float
    arrived_s: float


@dataclass(eq=False)
class _Goal:
    """An order and its progress."""

    command: DeviceCommand
    goal_id: bytes
    frame: str
    tree: str
    sent: bool = False
    accepted: bool = False
    cause: str = ""
    """The reason why the console itself ends the order; '' if it does not."""
    arrived_s: float | None = None
    """The time at which the robot reported its arrival."""
    answer: DeviceAnswer | None = None
    """The last answer to the command."""

    @property
    def over(self) -> bool:
        """True once the command has its final answer."""
        return self.answer is not None and self.answer.status in FINAL_REPLIES


@dataclass
class Navigator:
    """The execution of the commands to one robot; one thread calls all members, `step` often."""

    name: str
    entry: RobotEntry
    site: RobotSite
    nav2: "Nav2Server"
    answer: Callable[[DeviceAnswer], object]
    warn: Callable[[str], object]
    """A function that reports a line to the operator."""
    clock: Callable[[], float]
    """A monotonic clock, in seconds."""
    manual: bool = False
    """True while a person steers the robot."""
    not_ready: str = ""
    """The reason why the robot cannot start; '' if it can."""
    seen: Seen | None = None
    """The place and the speed of the robot; None while they are unknown."""
    _goals: dict[str, _Goal] = field(default_factory=dict[str, _Goal])
    _waiting: _Goal | None = None
    """An order that is sent once the current one is cancelled."""
    _hold: DeviceCommand | None = None
    """The current hold, until the robot has stopped."""
    _cancelled_s: float = math.inf
    """The time at which the robot confirmed the cancellation for the current hold."""
    _reports: dict[DeviceCommand, float] = field(default_factory=dict[DeviceCommand, float])
    _states: Mapping[bytes, int] = field(default_factory=dict[bytes, int])
    _stays: Task = "idle"
    _salt: uuid.UUID = field(default_factory=uuid.uuid4)

    @property
    def command_id(self) -> str | None:
        """The id of the command that the robot carries out; None if there is none."""
        running = self._running()
        return running.command.command_id if running is not None else None

    @property
    def task(self) -> Task:
        """The robot's task."""
        running = self._running()
        if running is not None and running.accepted:
            return "returning" if running.command.verb == "return_to_base" else "moving"
        return "moving" if self._active() else self._stays

    def send(self, command: DeviceCommand) -> None:
        """Send `command`, or repeat the last answer if it was sent before."""
        if command.verb == "hold":
            self._stop(command)
        elif (goal := self._goals.get(command.command_id)) is not None:
            if goal.answer is not None:
                self.answer(goal.answer)
        elif command.verb == "report":
            self._say(command, "acknowledged")
            self._reports[command] = self.clock()
        elif why := self._cannot(command):
            self._say(command, "refused", why)
        else:
            self._order(command)

    def reported(self, arrived_s: float) -> None:
        """Answer the report commands that were sent before a report arrived at `arrived_s`."""
        for command in [c for c, asked_s in self._reports.items() if asked_s < arrived_s]:
            del self._reports[command]
            self._say(command, "done", "reported")

    def see_states(self, states: Mapping[bytes, int]) -> None:
        """Process the states of the robot's goals."""
        own = {goal.goal_id: goal for goal in self._goals.values()}
        for goal_id in self._active(states):
            if goal_id in own:
                self._acknowledge(own[goal_id])
            elif goal_id not in self._states:
                self.warn("drives to a goal that was not given from here")
        self._states = states

    def step(self) -> None:
        """Process whatever is due: arrivals, a waiting goal, and the end of a hold."""
        for goal in self._goals.values():
            if goal.arrived_s is not None and not goal.over:
                self._arrive(goal, self.clock() - goal.arrived_s)
        if self._waiting is not None and self._running() is None:
            goal, self._waiting = self._waiting, None
            self._go(goal)
        if self._hold is not None and self.seen is not None and not self._active():
            left = any(goal.sent and not goal.over for goal in self._goals.values())
            stands = self.seen.speed_mps <= STANDS_MPS
            if stands and not left and self.seen.arrived_s > self._cancelled_s:
                self._say(self._hold, "done", "stands")
                self._hold, self._stays = None, "holding"

    def _active(self, states: Mapping[bytes, int] | None = None) -> list[bytes]:
        return [g for g, state in (states or self._states).items() if state in ACTIVE]

    # Orders

    def _cannot(self, command: DeviceCommand) -> str:
        """Return why the robot cannot carry out `command`; '' if it can."""
        action, servers = self.entry.named(self.name, self.entry.action), self.nav2.servers
        if self.manual:
            return "a person steers it"
        if command.verb not in self.entry.able:
            return f"it is not able to {command.verb}: its connection file does not list it"
        if command.target is not None and command.target not in self.site.world.frames:
            return f"there is no frame {command.target}"
        if servers > 1:
            return f"{servers} action servers are called {action}: stop all but one"
        if not servers:
            return f"there is no action server {action}"
        return f"not ready: {self.not_ready}" if self.not_ready else ""

    def _running(self) -> _Goal | None:
        """Return the newest order that the robot may be carrying out; None if there is none."""
        for goal in reversed(self._goals.values()):
            if goal.sent and goal.arrived_s is None and not goal.over:
                return goal
        return None

    def _order(self, command: DeviceCommand) -> None:
        """Replace the robot's goal with a new one.

        Nav2 replaces its goal by itself if both goals have the same behaviour tree. Otherwise, it
        would keep the old goal, so the old goal is cancelled first.
        """
        running, self._waiting, self._hold = self._running(), None, None
        self._supersede("a newer order took its place")
        goal = self._goals[command.command_id] = _Goal(
            command,
            uuid.uuid5(self._salt, command.command_id).bytes,
            command.target or self.site.world.base,
            self.entry.trees.get(command.verb, ""),
        )
        if len(self._goals) > MOST_GOALS:
            del self._goals[next(iter(self._goals))]
        if running is not None and running.tree != goal.tree:
            self._waiting = goal
            self.nav2.cancel(running.goal_id, lambda _: None)
        else:
            self._go(goal)

    def _supersede(self, cause: str) -> None:
        """Set the reason why the unfinished orders end; an order that was not sent ends at once."""
        for goal in self._goals.values():
            if not goal.over:
                goal.cause = cause
                if not goal.sent:
                    self._answer(goal, "failed", cause)

    def _go(self, goal: _Goal) -> None:
        at = self.site.world.frames[goal.frame].at
        heading = 0.0
        if self.seen is not None:  # keep the direction of travel, without a turn at the end
            heading = math.atan2(at[1] - self.seen.at[1], at[0] - self.seen.at[0])
        goal.sent = True
        place = self.site.fit.to_map(Planar(*at, heading))
        self.nav2.go(goal.goal_id, place, goal.tree, partial(self._accepted, goal))

    def _accepted(self, goal: _Goal, accepted: bool | None) -> None:
        """Process the answer to a goal; without an answer, its result is still requested."""
        if accepted:
            self._acknowledge(goal)
        if accepted is not False:
            self._ask(goal)
        elif not goal.accepted:
            self._answer(goal, "refused", "it rejects the goal")

    def _acknowledge(self, goal: _Goal) -> None:
        if goal.accepted or goal.over:
            return
        goal.accepted, self._stays = True, "idle"
        self._answer(goal, "acknowledged")
        if goal.cause == HELD:  # the robot received the hold before this goal
            self.nav2.cancel(goal.goal_id, lambda _: None)

    def _ask(self, goal: _Goal) -> None:
        self.nav2.ask(goal.goal_id, partial(self._result, goal))

    def _result(self, goal: _Goal, result: tuple[int, str] | None) -> None:
        """Process the answer to a request for the result of a goal."""
        if goal.over:
            return
        state, error = result or (ACTIVE[0], "")
        if state == UNKNOWN:
            why = "it no longer knows the goal: was it restarted?"
            if not goal.accepted:
                why = goal.cause or "it never answered: the goal was lost, and is not sent again"
            self._answer(goal, "failed", why)
        elif state in ACTIVE:
            self._ask(goal)
        else:
            self._acknowledge(goal)
            if state == SUCCEEDED:
                goal.arrived_s = self.clock()
                self._arrive(goal, 0.0)
            else:
                why = error or "it gave up without giving a reason"
                why = "cancelled by another program" if state == CANCELED else why
                self._answer(goal, "failed", goal.cause or why)

    def _arrive(self, goal: _Goal, waited_s: float) -> None:
        """Answer that the robot has arrived, if its place confirms the arrival.

        The order fails if the place does not confirm the arrival within ARRIVED_S.
        """
        frame, world = self.site.world.frames[goal.frame], self.site.world
        off_m = math.dist(self.seen.at, frame.at) if self.seen is not None else math.inf
        near_m = frame.radius_m
        if goal.command.verb in ADDRESSING:  # the robot stops at a distance from the contacts
            near_m += world.platforms["robot"].sensor_range_m
        if off_m <= near_m:
            self._stays = COMMANDS[goal.command.verb].task or "idle"
            self._answer(goal, "done", f"at {goal.frame}")
        elif waited_s >= ARRIVED_S:
            where = f"{off_m:.0f} m away" if math.isfinite(off_m) else "unknown"
            why = f"it reports its arrival at {goal.frame}, but its place is {where}"
            self._answer(goal, "failed", why)

    # Holds

    def _stop(self, command: DeviceCommand) -> None:
        """Cancel every goal of the robot, including the goals of other clients."""
        if self._hold is None or self._hold.command_id != command.command_id:
            self._hold, self._cancelled_s = command, math.inf
        self.nav2.cancel(None, partial(self._cancelled, command))
        self._waiting = None
        self._supersede(HELD)

    def _cancelled(self, hold: DeviceCommand, code: int | None) -> None:
        """Process the answer to a request to cancel all goals."""
        if hold is not self._hold:
            return
        if code is None:
            self.nav2.cancel(None, partial(self._cancelled, hold))
        elif code != 0:
            self._say(hold, "refused", "it rejects the request to cancel its goals")
        elif self._cancelled_s == math.inf:
            self._cancelled_s = self.clock()
            self._say(hold, "acknowledged")

    def _answer(self, goal: _Goal, status: ReplyStatus, detail: str = "") -> None:
        goal.answer = self._say(goal.command, status, detail)

    def _say(self, command: DeviceCommand, status: ReplyStatus, detail: str = "") -> DeviceAnswer:
        answer = DeviceAnswer(command.command_id, self.name, status, detail)
        self.answer(answer)
        return answer
