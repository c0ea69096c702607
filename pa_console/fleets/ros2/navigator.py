"""The goals of one robot: its orders, its answers, and the end of each order.

An order is a goal of Nav2's action `NavigateToPose`, whose id is made from the command's. Action
servers in C++ end with an exception if a known id arrives again (rclcpp_action, "Failed to accept
new goal"), so no goal is ever sent twice: if its answer is missing, its result is requested.

Information about goals comes from three sources: the status topic, which is quick but may be
missed; the answer to the request for the result, which arrives at the goal's end; and the feedback.
"""

import math
import uuid
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from pa_console.fleets.link import DeviceAnswer
from pa_console.fleets.ros2.connection import RobotEntry, RobotSite
from pa_console.fleets.ros2.messages import REJECTED, Feedback, GoalResult, GoalState, Planar
from pa_console.schema.base import Point
from pa_console.schema.command import (
    ADDRESSING,
    COMMANDS,
    FINAL_REPLIES,
    DeviceCommand,
    ReplyStatus,
)
from pa_console.schema.telemetry import Task

ARRIVED_S = 2.0
"""The pose of a robot that reports its arrival must confirm it within this time, seconds."""

REASON_S = 1.0
"""The longest wait for a robot's own reason after its goal has ended, seconds."""

POLL_S = 1.0
"""The interval of requests for the results of open goals, seconds."""

PROGRESS_S = 5.0
"""Progress is reported this often, seconds."""

STANDS_MPS = 0.05
"""A robot that is no faster than this stands: measured speeds are never quite zero."""

MOST_GOALS = 256
"""Orders of one robot that are remembered, to be answered again."""


class Nav2(Protocol):
    """The action server of a robot; `then` gets its answer later, or None if it gives none."""

    @property
    def servers(self) -> int:
        """The number of action servers that have the name; more than one is a mistake."""
        ...

    def go(self, goal_id: bytes, at: Planar, tree: str, then: Callable[[bool | None], None]) -> None:
        """Send a goal, a place on the robot's map; `then` learns whether it is accepted."""
        ...

    def cancel(self, goal_id: bytes | None, then: Callable[[int | None], None]) -> None:
        """Cancel a goal, or all goals of all clients; `then` gets a `CancelGoal` return code."""
        ...

    def ask(self, goal_id: bytes, then: Callable[[GoalResult | None], None]) -> None:
        """Ask for the result of a goal; the answer comes at its end, or if it is not known."""
        ...


@dataclass(frozen=True)
class Seen:
    """The place of a robot in the world and its speed, and when that came in (monotonic)."""

    at: Point
    heading_rad: float
    speed_mps: float
    arrived_s: float


@dataclass(eq=False)
class _Goal:
    """An order, and what has become of it."""

    command: DeviceCommand
    goal_id: bytes
    frame: str
    tree: str
    sent: bool = False
    asking: bool = False
    """True while the answer to the question for its result is awaited."""
    asked_s: float = -math.inf
    state: GoalState = GoalState.UNKNOWN
    held: bool = False
    """True once a hold came after it."""
    replaced: bool = False
    """True once a newer order came after it."""
    ended_s: float | None = None
    """The time at which it was reported as ended; the answer follows once the reason is known."""
    said: DeviceAnswer | None = None
    told_s: float = -math.inf

    @property
    def over(self) -> bool:
        """True once the command has had its last answer."""
        return self.said is not None and self.said.status in FINAL_REPLIES

    @property
    def runs(self) -> bool:
        """True while the robot may be carrying it out."""
        return self.sent and self.ended_s is None and not self.over

    @property
    def cause(self) -> str:
        """Why the console itself has ended it, '' if it has not."""
        if self.held:
            return "stopped by a hold"
        return "a newer order took its place" if self.replaced else ""


@dataclass
class _Hold:
    """A hold, until the robot stands."""

    command: DeviceCommand
    cancelled_s: float | None = None
    """The time of the robot's report that it cancels."""


@dataclass
class Navigator:
    """Carries out the commands to one robot; `step` is called often, all on one thread."""

    name: str
    entry: RobotEntry
    site: RobotSite
    nav2: Nav2
    answer: Callable[[DeviceAnswer], object]
    warn: Callable[[str], object]
    """Takes a line for the operator."""
    clock: Callable[[], float]
    """Returns monotonic seconds."""
    manual: bool = False
    """True while a person steers the robot."""
    _goals: OrderedDict[str, _Goal] = field(default_factory=OrderedDict[str, _Goal])
    _waiting: _Goal | None = None
    """An order that is sent once the running one is cancelled."""
    _hold: _Hold | None = None
    _reports: list[tuple[DeviceCommand, float]] = field(
        default_factory=list[tuple[DeviceCommand, float]]
    )
    _states: Mapping[bytes, GoalState] = field(default_factory=dict[bytes, GoalState])
    _foreign: set[bytes] = field(default_factory=set[bytes])
    _seen: Seen | None = None
    _stays: Task = "idle"
    _salt: uuid.UUID = field(default_factory=uuid.uuid4)

    @property
    def command_id(self) -> str | None:
        """The command that the robot carries out, None for none."""
        running = self._running()
        return running.command.command_id if running is not None else None

    @property
    def task(self) -> Task:
        """The robot's task."""
        running = self._running()
        if running is not None and running.state.active:
            return "returning" if running.command.verb == "return_to_base" else "moving"
        return "moving" if any(s.active for s in self._states.values()) else self._stays

    def send(self, command: DeviceCommand) -> None:
        """Send `command`, or repeat the last answer if it was sent before."""
        if command.verb == "hold":
            self._stop(command)
        elif (known := self._goals.get(command.command_id)) is not None:
            if known.said is not None:
                self.answer(known.said)
        elif command.verb == "report":
            self._say(command, "acknowledged")
            self._reports.append((command, self.clock()))
        elif why := self._cannot(command):
            self._say(command, "refused", why)
        else:
            self._order(command)

    def reported(self, arrived_s: float) -> None:
        """Note that a report of the robot came in at `arrived_s`."""
        for command, asked_s in self._reports:
            if arrived_s > asked_s:
                self._say(command, "done", "reported")
        self._reports = [each for each in self._reports if arrived_s <= each[1]]

    def see_states(self, states: Mapping[bytes, GoalState]) -> None:
        """Take in the status of the robot's goals."""
        self._states = states
        own = {goal.goal_id: goal for goal in self._goals.values()}
        for goal_id, state in states.items():
            if goal_id in own:
                self._advance(own[goal_id], state)
            elif state.active and goal_id not in self._foreign:
                self._foreign.add(goal_id)
                self.warn("drives to a goal that was not given from here")
        self._foreign &= set(states)

    def see_feedback(self, feedback: Feedback) -> None:
        """Take in the progress towards a goal."""
        for goal in self._goals.values():
            if goal.goal_id != feedback.goal_id or not goal.runs:
                continue
            self._advance(goal, GoalState.EXECUTING)
            if self.clock() - goal.told_s >= PROGRESS_S:
                goal.told_s = self.clock()
                detail = f"{feedback.distance_m:.0f} m to go"
                if feedback.recoveries:
                    detail += f", recovered {feedback.recoveries} times"
                self._answer(goal, "progress", detail)

    def see_place(self, seen: Seen) -> None:
        """Take in where the robot is."""
        self._seen = seen

    def step(self) -> None:
        """Do what is due: questions, arrivals, a goal that waits, and the end of a hold."""
        now_s = self.clock()
        for goal in list(self._goals.values()):
            if goal.ended_s is not None and not goal.over:
                self._conclude(goal, GoalResult(goal.state))
            elif goal.runs and goal.state.active and now_s - goal.asked_s >= POLL_S:
                self._ask(goal)
        if self._waiting is not None and self._running() is None:
            goal, self._waiting = self._waiting, None
            self._go(goal)
        if self._hold is not None:
            self._end_hold(self._hold)

    # Orders

    def _cannot(self, command: DeviceCommand) -> str:
        """Return why the robot cannot carry out `command`, '' if it can."""
        if self.manual:
            return "a person steers it"
        if command.verb not in self.entry.able:
            return f"it is not able to {command.verb}: its connection file does not name that"
        if command.target is not None and command.target not in self.site.world.frames:
            return f"there is no frame {command.target}"
        if self.nav2.servers == 1:
            return ""
        action = self.entry.named(self.name, self.entry.action)
        if self.nav2.servers == 0:
            return f"no action server {action} is there"
        return f"{self.nav2.servers} action servers are called {action}: stop all but one"

    def _running(self) -> _Goal | None:
        """Return the newest order that the robot may be carrying out."""
        return next((goal for goal in reversed(self._goals.values()) if goal.runs), None)

    def _order(self, command: DeviceCommand) -> None:
        """Replace the robot's goal by a new one.

        Nav2 changes over to a goal by itself, unless that has another behaviour tree: then it keeps
        the old one, so that is cancelled first.
        """
        running, self._waiting, self._hold = self._running(), None, None
        for each in self._goals.values():
            each.replaced = each.replaced or not each.over
            if not each.over and not each.sent:
                self._answer(each, "failed", "a newer order came before it was sent")
        goal = self._goals[command.command_id] = _Goal(
            command,
            uuid.uuid5(self._salt, command.command_id).bytes,
            command.target or self.site.world.base,
            self.entry.trees.get(command.verb, ""),
        )
        while len(self._goals) > MOST_GOALS:
            self._goals.popitem(last=False)
        if running is not None and running.tree != goal.tree:
            self._waiting = goal
            self.nav2.cancel(running.goal_id, lambda _: None)
        else:
            self._go(goal)

    def _go(self, goal: _Goal) -> None:
        at = self.site.world.frames[goal.frame].at
        heading = 0.0
        if self._seen is not None:  # it arrives as it came, without a turn at the end
            heading = math.atan2(at[1] - self._seen.at[1], at[0] - self._seen.at[0])
        goal.sent = True
        place = self.site.fit.to_map(Planar(*at, heading))
        self.nav2.go(goal.goal_id, place, goal.tree, partial(self._accepted, goal))

    def _accepted(self, goal: _Goal, accepted: bool | None) -> None:
        """Take in the answer to a goal."""
        if accepted:
            self._advance(goal, GoalState.ACCEPTED)
        elif not goal.runs or goal.state.active:
            pass
        elif accepted is None:
            self._ask(goal)
        else:
            self._answer(goal, "refused", "it rejects the goal")

    def _ask(self, goal: _Goal) -> None:
        if not goal.asking:
            goal.asking, goal.asked_s = True, self.clock()
            self.nav2.ask(goal.goal_id, partial(self._result, goal))

    def _result(self, goal: _Goal, result: GoalResult | None) -> None:
        """Take in the answer to the question for a result."""
        goal.asking = False
        if goal.over:
            return
        if result is None:
            if goal.state == GoalState.UNKNOWN:
                self._ask(goal)
        elif result.state == GoalState.UNKNOWN:
            why = "it does not know the goal any more: was it started again?"
            if goal.state == GoalState.UNKNOWN:
                why = goal.cause or "it never answered: the goal got lost, and is not sent again"
            self._answer(goal, "failed", why)
        elif not result.state.active:
            self._conclude(goal, result)

    def _advance(self, goal: _Goal, state: GoalState) -> None:
        """Take in a state of a goal that the robot reports."""
        if goal.over or goal.ended_s is not None:
            return
        if state.active:
            first = goal.state == GoalState.UNKNOWN
            goal.state = max(goal.state, state)
            if first:
                self._stays = "idle"
                self._answer(goal, "acknowledged")
                if goal.held:  # it overtook the hold on its way to the robot
                    self.nav2.cancel(goal.goal_id, lambda _: None)
        elif state != GoalState.UNKNOWN:
            goal.state, goal.ended_s = state, self.clock()
            if state == GoalState.ABORTED and not goal.replaced:
                self._ask(goal)

    def _conclude(self, goal: _Goal, result: GoalResult) -> None:
        """Give the last answer to a command whose goal has ended, once that can be given."""
        if goal.said is None:
            self._answer(goal, "acknowledged")
        goal.state = result.state
        goal.ended_s = goal.ended_s if goal.ended_s is not None else self.clock()
        waited_s = self.clock() - goal.ended_s
        if result.state == GoalState.SUCCEEDED:
            self._arrive(goal, waited_s)
        elif result.state == GoalState.CANCELED:
            self._answer(goal, "failed", goal.cause or "cancelled by somebody else")
        elif why := goal.cause or result.reason:
            self._answer(goal, "failed", why)
        elif waited_s >= REASON_S or not goal.asking:
            self._answer(goal, "failed", "it gave up and gives no reason")

    def _arrive(self, goal: _Goal, waited_s: float) -> None:
        """Answer that a robot has arrived, if its own place shows it."""
        frame, world = self.site.world.frames[goal.frame], self.site.world
        off_m = math.dist(self._seen.at, frame.at) if self._seen is not None else math.inf
        near_m = frame.radius_m
        if goal.command.verb in ADDRESSING:  # it stops at a distance from contacts there
            near_m += world.platforms["robot"].sensor_range_m
        if off_m <= near_m:
            self._stays = COMMANDS[goal.command.verb].task or "idle"
            self._answer(goal, "done", f"at {goal.frame}")
        elif waited_s >= ARRIVED_S:
            where = f"reports itself {off_m:.0f} m away" if math.isfinite(off_m) else "is not seen"
            self._answer(goal, "failed", f"it says that it is at {goal.frame}, but {where}")

    # Holds

    def _stop(self, command: DeviceCommand) -> None:
        """Cancel every goal of the robot, those of other clients too."""
        self._waiting = None
        if self._hold is None or self._hold.command.command_id != command.command_id:
            self._hold = _Hold(command)
        self.nav2.cancel(None, partial(self._cancelled, self._hold))
        for goal in self._goals.values():
            goal.held = goal.held or not goal.over
            if not goal.over and not goal.sent:
                self._answer(goal, "failed", goal.cause)

    def _cancelled(self, hold: _Hold, code: int | None) -> None:
        """Take in the answer to a request to cancel all goals."""
        if code is None or hold is not self._hold:
            return
        if code == REJECTED:
            self._say(hold.command, "refused", "it rejects the request to cancel its goals")
        elif hold.cancelled_s is None:
            hold.cancelled_s = self.clock()
            self._say(hold.command, "acknowledged")

    def _end_hold(self, hold: _Hold) -> None:
        """Answer that a robot holds: its goals are over, and it reports since that it stands."""
        left = any(goal.sent and not goal.over for goal in self._goals.values())
        active = any(state.active for state in self._states.values())
        seen, since_s = self._seen, hold.cancelled_s
        if left or active or seen is None or since_s is None:
            return
        if seen.arrived_s > since_s and seen.speed_mps <= STANDS_MPS:
            self._hold, self._stays = None, "holding"
            self._say(hold.command, "done", "stands")

    # Answers

    def _answer(self, goal: _Goal, status: ReplyStatus, detail: str = "") -> None:
        goal.said = self._say(goal.command, status, detail)

    def _say(self, command: DeviceCommand, status: ReplyStatus, detail: str = "") -> DeviceAnswer:
        said = DeviceAnswer(command.command_id, self.name, status, detail)
        self.answer(said)
        return said
