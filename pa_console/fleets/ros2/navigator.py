"""The goals of one robot: its orders, its answers, and the end of each order.

An order is a goal of Nav2's action `NavigateToPose`, whose id is made from the command's. Action
servers in C++ end with an exception if a known id arrives again (rclcpp_action, "Failed to accept
new goal"), and servers in Python reject it. So an unanswered order is never simply sent again: its
result is requested first, and only a robot that answers at once that it does not know the goal gets
it again.

Information about goals comes from three sources: the status topic, which is quick but may be
missed; the answer to the request for the result, which arrives at the goal's end; and the feedback.
"""

import math
import time
import uuid
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from pa_console.fleets.link import DeviceAnswer
from pa_console.fleets.ros2 import messages
from pa_console.fleets.ros2.connection import RobotSite
from pa_console.fleets.ros2.messages import (
    CancelCode,
    Feedback,
    GoalResult,
    GoalState,
    Planar,
    UnreadableError,
)
from pa_console.schema.base import Point
from pa_console.schema.command import (
    ADDRESSING,
    COMMANDS,
    FINAL_REPLIES,
    DeviceCommand,
    ReplyStatus,
)
from pa_console.schema.telemetry import Task

CALL_S = 3.0
"""A service that has not answered within this time does not answer, seconds."""

RESULT_S = 300.0
"""The question for a result is asked anew after this time, seconds; bridges give up then too."""

RESEND_S = 8.0
"""An unanswered order is sent again for this long, seconds: action servers forget goals that have
ended after ten, and would carry one out a second time."""

ARRIVED_S = 2.0
"""The pose of a robot that reports its arrival must confirm it within this time, seconds."""

REASON_S = 1.0
"""The longest wait for a robot's own reason after its goal has ended, seconds."""

POLL_S = 1.0
"""The interval of requests for the results of open goals after a hold, seconds."""

PROGRESS_S = 5.0
"""Progress is reported this often, seconds."""

STANDS_MPS = 0.05
"""A robot that is no faster than this stands: measured speeds are never quite zero."""

MOST_GOALS = 256
"""Orders of one robot that are remembered, to be answered again."""

T = TypeVar("T")

Then = Callable[[bytes | None], None]
"""Takes the answer of a service; None when it did not answer."""

Call = Callable[[str, bytes, float, Then], bool]
"""Calls a service of the robot, NAME or ACTION/NAME, with a time-out; False if it is not there."""


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
    first_s: float = -math.inf
    """When it was sent for the first time; never yet if that is negative."""
    tries: int = 0
    sending: bool = False
    """True while the answer to the goal is awaited."""
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


@dataclass
class _Hold:
    """A hold, until the robot stands."""

    command: DeviceCommand
    cancelled_s: float | None = None
    """The time of the robot's report that it cancels."""
    polled_s: float = -math.inf


class Navigator:
    """Commands one robot through `call`; `take` returns its answers."""

    def __init__(
        self,
        name: str,
        site: RobotSite,
        call: Call,
        *,
        clock: Callable[[], float] = time.monotonic,
        now: Callable[[], float] = time.time,
    ) -> None:
        self._name, self._entry = name, site.connection.robots[name]
        self._world, self._fit = site.world, site.fit
        self._call, self._clock, self._now = call, clock, now
        self._salt = uuid.uuid4()
        """Begins every goal id of this connection, so that no other client can use one up."""
        self._goals: OrderedDict[str, _Goal] = OrderedDict()
        self._waiting: _Goal | None = None
        """An order that is sent once the running one has ended."""
        self._hold: _Hold | None = None
        self._reports: list[tuple[DeviceCommand, float]] = []
        self._states: Mapping[bytes, GoalState] = {}
        self._seen: Seen | None = None
        self._stays: Task = "idle"
        """The task of the robot while it has no goal."""
        self._foreign: set[bytes] = set()
        self._answers: list[DeviceAnswer] = []
        self.manual = False
        """True while a person steers the robot: it takes no order then, only holds."""
        self.problems: list[str] = []
        """Notices for the operator, without the robot's name; the owner empties it."""

    def take(self) -> list[DeviceAnswer]:
        """Return the answers since the last call."""
        answers, self._answers = self._answers, []
        return answers

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
        """Send `command`, or find out what has become of it if it was sent before."""
        if command.verb == "hold":
            self._stop(command)
        elif (known := self._goals.get(command.command_id)) is not None:
            self._again(known)
        elif command.verb == "report":
            self._say(command, "acknowledged")
            self._reports.append((command, self._clock()))
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
                self.problems.append("drives to a goal that was not given from here")
        self._foreign &= set(states)

    def see_feedback(self, feedback: Feedback) -> None:
        """Take in the progress towards a goal."""
        for goal in self._goals.values():
            if goal.goal_id != feedback.goal_id or goal.over or goal.ended_s is not None:
                continue
            self._advance(goal, GoalState.EXECUTING)
            if self._clock() - goal.told_s >= PROGRESS_S:
                goal.told_s = self._clock()
                detail = f"{feedback.distance_m:.0f} m to go"
                if feedback.recoveries:
                    detail += f", recovered {feedback.recoveries} times"
                self._answer(goal, "progress", detail)

    def see_place(self, seen: Seen) -> None:
        """Take in where the robot is."""
        self._seen = seen

    def step(self) -> None:
        """Do what is due: reasons, results, arrivals, and the end of a hold."""
        now_s = self._clock()
        for goal in list(self._goals.values()):
            if goal.over or not goal.tries:
                continue
            if goal.ended_s is not None:
                self._conclude(goal, GoalResult(goal.state))
            elif goal.state.active and not goal.asking and now_s - goal.asked_s >= POLL_S:
                self._ask(goal)
        if self._waiting is not None and self._running() is None:
            goal, self._waiting = self._waiting, None
            self._try(goal)
        if self._hold is not None:
            self._end_hold(self._hold)

    # Orders

    def _cannot(self, command: DeviceCommand) -> str:
        """Return why the robot cannot carry out `command`, '' if it can."""
        if self.manual:
            return "a person steers it"
        if command.verb not in self._entry.able:
            return f"it is not able to {command.verb}: its connection file does not name that"
        goal = self._frame(command)
        return "" if goal in self._world.frames else f"there is no frame {goal}"

    def _frame(self, command: DeviceCommand) -> str:
        return command.target or self._world.base

    def _running(self) -> _Goal | None:
        """Return the newest order that the robot may be carrying out."""
        return next(
            (
                g
                for g in reversed(self._goals.values())
                if g.tries and g.ended_s is None and not g.over
            ),
            None,
        )

    def _order(self, command: DeviceCommand) -> None:
        """Replace the robot's goal by a new one.

        Nav2 changes over to a goal by itself, unless that has another behaviour tree: then it keeps
        the old one, so that is cancelled first.
        """
        goal = _Goal(command, uuid.uuid5(self._salt, command.command_id).bytes)
        running, self._waiting = self._running(), None
        for each in self._goals.values():
            each.replaced = each.replaced or not each.over
            if not each.over and not each.tries:
                self._answer(each, "failed", "a newer order came before it was sent")
        self._goals[command.command_id] = goal
        while len(self._goals) > MOST_GOALS:
            self._goals.popitem(last=False)
        self._hold = None
        if running is not None and self._tree(running) != self._tree(goal):
            self._waiting = goal
            request = messages.write_cancel(running.goal_id)
            self._call("cancel_goal", request, CALL_S, lambda _: None)
        else:
            self._try(goal)

    def _tree(self, goal: _Goal) -> str:
        return self._entry.trees.get(goal.command.verb, "")

    def _try(self, goal: _Goal) -> None:
        """Send a goal."""
        at = self._world.frames[self._frame(goal.command)].at
        heading = 0.0
        if self._seen is not None:  # it arrives as it came, without a turn at the end
            heading = math.atan2(at[1] - self._seen.at[1], at[0] - self._seen.at[0])
        pose = self._fit.to_map(Planar(*at, heading))
        request = messages.write_goal(
            goal.goal_id, pose, self._entry.map_frame, self._now(), self._tree(goal)
        )
        sent = self._call("send_goal", request, CALL_S, partial(self._accepted, goal))
        if not sent:
            return
        goal.sending, goal.tries = True, goal.tries + 1
        goal.first_s = self._clock() if goal.tries == 1 else goal.first_s

    def _accepted(self, goal: _Goal, reply: bytes | None) -> None:
        """Take in the answer to a goal."""
        goal.sending = False
        if reply is None or goal.over or goal.ended_s is not None:
            return
        accepted = self._readable(messages.read_accepted, reply)
        if accepted is None:
            return
        if accepted:
            self._advance(goal, GoalState.ACCEPTED)
        elif goal.tries > 1 or goal.state.active:
            self._ask(goal)  # a known id is rejected as well, while the goal goes on
        else:
            self._answer(goal, "refused", "it rejects the goal")

    def _again(self, goal: _Goal) -> None:
        """Answer a repeated command; find out whether the robot has it, if that is not known."""
        if goal.said is not None:
            self._answers.append(goal.said)
        if goal.over or goal is self._waiting or goal.sending:
            return
        if not goal.tries:
            self._try(goal)
        elif not goal.asking:
            self._ask(goal)

    def _ask(self, goal: _Goal) -> None:
        """Ask for the result of a goal; the answer comes at its end, or if it is not known."""
        request = messages.write_result_request(goal.goal_id)
        if self._call("get_result", request, RESULT_S, partial(self._result, goal)):
            goal.asking = True
        goal.asked_s = self._clock()

    def _result(self, goal: _Goal, reply: bytes | None) -> None:
        """Take in the answer to the question for a result."""
        goal.asking = False
        result = self._readable(messages.read_result, reply) if reply is not None else None
        if result is None or goal.over:
            return
        if result.state == GoalState.UNKNOWN:
            self._unknown(goal)
        elif not result.state.active:
            self._conclude(goal, result)

    def _unknown(self, goal: _Goal) -> None:
        """See to a goal that the robot does not know: it never came, or is forgotten."""
        if goal.state != GoalState.UNKNOWN:
            why = "it does not know the goal any more: was it started again?"
            self._answer(goal, "failed", why)
        elif why := self._cause(goal):
            self._answer(goal, "failed", why)
        elif self._clock() - goal.first_s <= RESEND_S:
            self._try(goal)
        else:
            why = "it never answered, and may have carried it out meanwhile: not sent again"
            self._answer(goal, "failed", why)

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
                    request = messages.write_cancel(goal.goal_id)
                    self._call("cancel_goal", request, CALL_S, lambda _: None)
        elif state != GoalState.UNKNOWN:
            goal.state, goal.ended_s = state, self._clock()
            if state == GoalState.ABORTED and not goal.replaced and not goal.asking:
                self._ask(goal)

    def _conclude(self, goal: _Goal, result: GoalResult) -> None:
        """Give the last answer to a command whose goal has ended, once that can be given."""
        if goal.said is None:
            self._answer(goal, "acknowledged")
        goal.state = result.state
        now_s = self._clock()
        goal.ended_s = goal.ended_s if goal.ended_s is not None else now_s
        waited_s = now_s - goal.ended_s
        match result.state:
            case GoalState.SUCCEEDED:
                self._arrive(goal, waited_s)
            case GoalState.CANCELED:
                self._answer(goal, "failed", self._cause(goal) or "cancelled by somebody else")
            case GoalState.ABORTED:
                if why := self._cause(goal) or result.reason:
                    self._answer(goal, "failed", why)
                elif waited_s >= REASON_S or not goal.asking:
                    self._answer(goal, "failed", "it gave up and gives no reason")
            case _:
                pass

    def _cause(self, goal: _Goal) -> str:
        """Return why the console itself has ended a goal, '' if it has not."""
        if goal.held:
            return "stopped by a hold"
        return "a newer order took its place" if goal.replaced else ""

    def _arrive(self, goal: _Goal, waited_s: float) -> None:
        """Answer that a robot has arrived, if its own place shows it."""
        name = self._frame(goal.command)
        frame = self._world.frames[name]
        off_m = math.dist(self._seen.at, frame.at) if self._seen is not None else math.inf
        near_m = frame.radius_m
        if goal.command.verb in ADDRESSING:  # it stops at a distance from contacts there
            near_m += self._world.platforms["robot"].sensor_range_m
        if off_m <= near_m:
            self._stays = COMMANDS[goal.command.verb].task or "idle"
            self._answer(goal, "done", f"at {name}")
        elif waited_s >= ARRIVED_S:
            where = f"reports itself {off_m:.0f} m away" if math.isfinite(off_m) else "is not seen"
            self._answer(goal, "failed", f"it says that it is at {name}, but {where}")

    # Holds

    def _stop(self, command: DeviceCommand) -> None:
        """Cancel every goal of the robot, those of other clients too."""
        self._waiting = None
        for goal in self._goals.values():
            goal.held = goal.held or not goal.over
            if not goal.over and not goal.tries:
                self._answer(goal, "failed", "stopped by a hold")
        if self._hold is None or self._hold.command.command_id != command.command_id:
            self._hold = _Hold(command)
        request = messages.write_cancel(None)
        self._call("cancel_goal", request, CALL_S, partial(self._cancelled, self._hold))
        for action in self._entry.stops:
            self._call(f"{action}/cancel_goal", request, CALL_S, lambda _: None)

    def _cancelled(self, hold: _Hold, reply: bytes | None) -> None:
        """Take in the answer to a request to cancel all goals."""
        code = self._readable(messages.read_cancelled, reply) if reply is not None else None
        if code is None or hold is not self._hold:
            return
        if code == CancelCode.REJECTED:
            self._say(hold.command, "refused", "it rejects the request to cancel its goals")
        elif hold.cancelled_s is None:
            hold.cancelled_s = self._clock()
            self._say(hold.command, "acknowledged")

    def _end_hold(self, hold: _Hold) -> None:
        """Answer that a robot holds: its goals are over, and it reports since that it stands."""
        if hold.cancelled_s is None:
            return
        now_s = self._clock()
        left = [goal for goal in self._goals.values() if goal.tries and not goal.over]
        if left and now_s - hold.polled_s >= POLL_S:
            hold.polled_s = now_s
            for goal in left:
                if not goal.asking:
                    self._ask(goal)
        still = (
            self._seen is not None
            and self._seen.arrived_s > hold.cancelled_s
            and self._seen.speed_mps <= STANDS_MPS
        )
        if still and not left and not any(s.active for s in self._states.values()):
            self._hold, self._stays = None, "holding"
            self._say(hold.command, "done", "stands")

    # Answers

    def _readable(self, read: Callable[[bytes], T], reply: bytes) -> T | None:
        """Return the content of a reply, None for one that cannot be read."""
        try:
            return read(reply)
        except UnreadableError as error:
            self.problems.append(f"its answer cannot be read: {error}")
            return None

    def _answer(self, goal: _Goal, status: ReplyStatus, detail: str = "") -> None:
        goal.said = self._say(goal.command, status, detail)

    def _say(self, command: DeviceCommand, status: ReplyStatus, detail: str = "") -> DeviceAnswer:
        answer = DeviceAnswer(command.command_id, self._name, status, detail)
        self._answers.append(answer)
        return answer
