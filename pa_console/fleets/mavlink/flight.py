"""The orders of one vehicle: the requests to its autopilot, and the outcome of each order.

Only this module sends and repeats commands that start a motion, so that a stop withdraws them. A
library that repeats a command by itself could make the drone fly on after a stop. An order is done
when telemetry shows that it is, not when the autopilot accepts it.
"""

import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from datetime import UTC, datetime

from pa_console.fleets.link import DeviceAnswer, LinkNews
from pa_console.fleets.mavlink import commands
from pa_console.fleets.mavlink.commands import Autopilot, MavCommand
from pa_console.fleets.mavlink.orders import (
    Climb,
    FlightOrder,
    HoldOrder,
    OrderPlanner,
    Step,
    Upload,
)
from pa_console.fleets.mavlink.vehicle_reports import ReportingVehicle
from pa_console.fleets.mavlink.vehicles_file import MavlinkVehicles
from pa_console.fleets.reports import AssetReport
from pa_console.schema.base import Point
from pa_console.schema.command import COMMANDS, DeviceCommand, ReplyStatus
from pa_console.schema.telemetry import Task
from pa_console.sim.worlds.geography import Geography
from pa_console.sim.worlds.terrain import Terrain

ACK_S, TRIES = 1.0, 4
"""The time between attempts to send an unanswered command, in seconds; the number of attempts."""

REASON_S = 0.4
"""The largest time between a refusal and the vehicle's text before or after it, in seconds."""

ARRIVED_M, DRIVEN_M = 1.5, 3.5
HEIGHT_M = 2.0
"""The distances from the target within which a vehicle counts as arrived, in metres.

They apply to a drone, to a ground vehicle (which stops 2 to 3 m from its target), and to a drone's
height.
"""

CLIMBED = 0.9
"""The fraction of the ordered altitude at which a drone counts as having taken off."""

STALL_S = 25.0
"""The time without progress after which an order has failed, in seconds."""

NEARER_M = 0.5
"""The least approach to the target that counts as progress, in metres."""

PROGRESS_S = 5.0
"""The time between progress answers of an order, in seconds."""

HOLD_S = 1.0
"""The time in another mode after which a hold is requested again, in seconds."""

KNOWN = 512
"""The number of recent command ids that are remembered."""

_HERE = ("HOLD", "OFFBOARD", "GUIDED", "TAKEOFF", "MISSION", "READY", "UNKNOWN")
_NOUNS = {"uav": "drone", "ugv": "ground vehicle"}


class Flight(ReportingVehicle):
    """The execution of the orders of one vehicle, the asset `agent`.

    Reports, answers and notices are passed to `tell`. No member waits; the link calls `step`
    several times a second.
    """

    def __init__(
        self,
        agent: str,
        autopilot: Autopilot,
        *,
        terrain: Terrain,
        geography: Geography,
        vehicles: MavlinkVehicles,
        tell: Callable[[LinkNews], None],
        now: Callable[[], float],
        others: Callable[[], Sequence[Point]] = tuple,
    ) -> None:
        """Start without an order; `others` returns the places of the other drones."""
        super().__init__(
            agent,
            autopilot,
            terrain=terrain,
            geography=geography,
            vehicles=vehicles,
            tell=tell,
            now=now,
        )
        self.place: Point | None = None
        """The place that the vehicle occupies or is on its way to."""
        self._planner = OrderPlanner(agent, terrain, geography, vehicles, others)
        self._order: FlightOrder | None = None
        self._hold: HoldOrder | None = None
        self._answers = OrderedDict[str, DeviceAnswer | None]()
        """The last answer to each command id; None while there is none."""
        self._task: Task = "idle"
        self._busy_until: dict[int, float] = {}

    # Commands from the station

    def take(self, command: DeviceCommand) -> None:
        """Carry out a command, once for each id; a hold is carried out each time."""
        if command.verb == "hold":
            self._stop(command)
            return
        answers = self._answers
        if command.command_id in answers:
            answer, order = answers[command.command_id], self._order
            if order is not None and order.command.command_id == command.command_id:
                order.tries = 0
            if answer is not None:
                self._tell(answer)
            return
        answers[command.command_id] = None
        if len(answers) > KNOWN:
            answers.popitem(last=False)
        if why := self._objection(command):
            self._answer(command, "refused", why)
        elif command.verb == "report":
            self._answer(command, "acknowledged")
            self._answer(command, "done", self._words())
        else:
            self._begin(command)

    def may_arm(self) -> bool:
        """Return whether an order from the station needs the vehicle to be armed now."""
        return self._order is not None and self._order.arming

    # Answers of the autopilot

    def acknowledged(self, command: int, result: int) -> None:
        """Process a COMMAND_ACK."""
        self._busy_until.pop(command, None)
        order = self._order
        step = order.steps[0] if order is not None and order.steps else None
        if order is None or not isinstance(step, MavCommand) or step.command != command:
            return
        if order.step_s is None or order.refused is not None:
            return
        if result == commands.IN_PROGRESS:
            order.step_s = self._now()
        elif result == commands.ACCEPTED or step.optional:
            self._next(order)
        else:
            name = commands.PLAINLY.get(command, str(command))
            word = commands.RESULTS.get(result, f"result {result}")
            order.refused = (f"{name} {word}", self._now())

    def uploaded(self, problem: str) -> None:
        """Process the result of the upload of a mission."""
        order = self._order
        if order is None or not order.steps or not isinstance(order.steps[0], Upload):
            return
        if order.step_s is None:
            return
        if problem:
            order.refused = (f"it does not take the mission ({problem})", self._now())
        else:
            self._next(order)

    def held(self, problem: str, *, answered: bool) -> None:
        """Process the result of a hold; the station repeats a hold that is not answered."""
        hold = self._hold
        if hold is None:
            return
        hold.asked = False
        if not problem:
            hold.accepted_s, hold.accepted_at = self._now(), datetime.now(UTC)
            self._answer(hold.command, "acknowledged")
        elif answered and not self.state.parked:
            hold.refused = (f"hold {problem}", self._now())
        elif answered:
            self._answer(hold.command, "acknowledged")
            self._answer(hold.command, "done", "stands on the ground, disarmed")
            hold.done = True

    # Steps in time

    def step(self) -> None:
        """Continue with the order: repeat requests, and detect refusals and lack of progress."""
        now, state = self._now(), self.state
        if state.fix is not None:
            self.fence.step(now, self._why_no_fence(state.fix.at))
        self._step_hold(now)
        self._note_readiness(now)
        order = self._order
        if order is None:
            if state.parked:
                home = self._task == "charging" and self._at_base()
                self._task = "charging" if home else "idle"
            elif self._task == "idle" or (self._task == "charging" and self._kind == "uav"):
                self._task = "holding"
            return
        if self._fenced_off(order):
            self._end(order, "failed", self.fence.problem)
            self._autopilot.hold()
        elif order.refused is not None:
            problem, since_s = order.refused
            if now - since_s >= REASON_S:
                self._give_reason(order.command, problem, since_s, order.acknowledged)
                self._order = None
        elif order.acknowledged and order.target and self._left_for_itself(order.started_s):
            self._end(order, "failed", self._left_words(order))
        elif not order.steps:
            self._follow(order, now)
        elif self._hold is None or not self._hold.waits(now):
            self._step(order, order.steps[0], now)

    def _begin(self, command: DeviceCommand) -> None:
        """Replace the current order with `command`, to which there is no objection."""
        state, world, fix = self.state, self._terrain.world, self.state.fix
        assert fix is not None
        home = command.verb == "return_to_base"
        stands = state.parked or (state.ground_bound and fix.speed_mps == 0.0)
        if home and stands and self._at_base():
            self._replace(None)
            self._task = "charging"
            self._answer(command, "acknowledged")
            self._answer(command, "done", f"at {world.base}")
            return
        order = self._planner.plan(command, state, fix, self._autopilot.kind, self._now())
        if isinstance(order, str):
            self._answer(command, "refused", order)
            return
        self._replace(order)
        self.place = order.target or world.frames[world.base].at
        self._task = "returning" if home else "moving"
        self.step()

    def _objection(self, command: DeviceCommand) -> str:
        """Return why a command cannot be carried out; '' if it can."""
        spec, state, frames = COMMANDS[command.verb], self.state, self._terrain.world.frames
        if self._kind not in spec.kinds:
            return f"a {_NOUNS[self._kind]} cannot {command.verb}"
        if spec.takes_frame and command.target not in frames:
            return f"unknown frame {command.target!r}; known: {', '.join(frames)}"
        if command.verb == "report":
            return ""
        if state.manual:
            return f"a pilot flies it ({state.mode}): it accepts orders again in another mode"
        return self._defect() or self._why_grounded(command)

    def _replace(self, order: FlightOrder | None) -> None:
        """Replace the current order with `order`; the current one fails as superseded."""
        old, self._order, self._hold = self._order, order, self._kept_hold()
        if old is not None:
            self._withdraw(old)
            self._answer(old.command, "failed", "superseded")

    def _kept_hold(self) -> HoldOrder | None:
        """End the current hold; return it if the autopilot has not answered it yet.

        No step of an order is sent before that answer.
        """
        hold = self._hold
        if hold is not None and not hold.done:
            self._answer(hold.command, "failed", "superseded")
            hold.done = True
        return hold if hold is not None and hold.asked else None

    def _withdraw(self, order: FlightOrder) -> None:
        if order.steps and isinstance(order.steps[0], Upload) and order.step_s is not None:
            self._autopilot.cancel_upload()

    # Orders under way

    def _step(self, order: FlightOrder, step: Step, now: float) -> None:
        """Request `step`, the first step of `order`; repeat a command that was not answered."""
        if self._fenced_off(order):
            return
        match step:
            case MavCommand():
                if order.step_s is None and now < self._busy_until.get(step.command, 0.0):
                    return
                due = order.step_s is None or now - order.step_s >= ACK_S
                if due and order.tries < TRIES:
                    self._autopilot.send(step, order.tries)
                    order.step_s, order.tries = now, order.tries + 1
                    self._busy_until[step.command] = now + ACK_S
            case Upload():
                if order.step_s is None:
                    order.step_s = now
                    self._autopilot.upload_mission(step.items)
            case Climb():
                self._climb(order, step, now)

    def _fenced_off(self, order: FlightOrder) -> bool:
        """Return whether a changed geofence prevents the order; a return in flight is exempt."""
        takes_off = any(isinstance(step, Climb) for step in order.steps)
        return self.fence.differs and (takes_off or order.command.verb != "return_to_base")

    def _climb(self, order: FlightOrder, step: Climb, now: float) -> None:
        order.step_s = order.step_s or now
        fix = self.state.fix
        if fix is not None and fix.altitude_m >= CLIMBED * step.altitude_m:
            self._next(order)
        elif self._left_for_itself(order.step_s):
            self._end(order, "failed", self._left_words(order))
        elif now - order.step_s > STALL_S:
            height = f"{fix.altitude_m:.0f} m" if fix is not None else "an unknown height"
            reason = f"it does not take off: at {height} after {STALL_S:.0f} s"
            self._end(order, "failed", self._with_words(reason, order.step_s))
        elif fix is not None:
            words = f"takes off: at {fix.altitude_m:.0f} of {step.altitude_m:.0f} m"
            self._progress(order, words, now)

    def _next(self, order: FlightOrder) -> None:
        """Continue with the next step; the success of the first step acknowledges the order."""
        now = self._now()
        order.steps.popleft()
        order.step_s, order.tries = None, 0
        if not order.acknowledged:
            order.acknowledged, order.told_s = True, now
            self._answer(order.command, "acknowledged")
        order.nearest_m, order.nearest_s, order.started_s = math.inf, now, now
        if order.steps:
            self._step(order, order.steps[0], now)

    def _follow(self, order: FlightOrder, now: float) -> None:
        """Report the progress of an order that the autopilot carries out; end it if it stalls."""
        fix, state = self.state.fix, self.state
        if fix is None:
            return
        target = (
            order.target or state.home or self._terrain.world.frames[self._terrain.world.base].at
        )
        gap = math.dist(fix.at, target)
        if not state.ground_bound:
            gap += abs((0.0 if order.target is None else order.altitude_m) - fix.altitude_m)
        if gap < order.nearest_m - NEARER_M:
            order.nearest_m, order.nearest_s = gap, now
        if now - order.nearest_s > STALL_S:
            words = f"it has not come nearer for {STALL_S:.0f} s, {gap:.0f} m to go"
            self._end(order, "failed", self._with_words(words, order.since_s))
        else:
            self._progress(order, f"{gap:.0f} m to go", now)

    def _left_for_itself(self, since_s: float) -> bool:
        """Return whether the autopilot has changed its mode by itself since `since_s`."""
        return self.state.mode not in _HERE and self.state.mode_s > since_s + HOLD_S

    def _left_words(self, order: FlightOrder) -> str:
        words = f"it has changed to {self.state.mode} by itself"
        return self._with_words(words, order.since_s)

    def _progress(self, order: FlightOrder, words: str, now: float) -> None:
        """Report the progress of an order every PROGRESS_S.

        The station sends an order again if no progress is reported.
        """
        if order.acknowledged and now - order.told_s >= PROGRESS_S:
            order.told_s = now
            self._answer(order.command, "progress", words)

    def _seen(self) -> None:
        self._look()
        self._tell(self._report())

    def _give_up(self, why: str) -> None:
        if self._order is not None:
            self._end(self._order, "failed", why)

    def _look(self) -> None:
        """End the order or the hold if the last reported position shows that it is done."""
        order, fix, state = self._order, self.state.fix, self.state
        if fix is None:
            return
        hold = self._hold
        if hold is not None and not hold.done and hold.accepted_at is not None:
            if fix.speed_mps == 0.0 and fix.sent > hold.accepted_at:
                hold.done = True
                at = self._terrain.frame_at(*fix.at) or "its place"
                self._answer(hold.command, "done", f"holding at {at}")
            return
        if order is None or order.steps or order.refused is not None:
            return
        if order.target is None:
            if state.parked and fix.speed_mps == 0.0:
                self._landed_home(order, fix.at)
        elif (
            math.dist(fix.at, order.target) <= (DRIVEN_M if state.ground_bound else ARRIVED_M)
            and (state.ground_bound or abs(fix.altitude_m - order.altitude_m) <= HEIGHT_M)
            and fix.speed_mps == 0.0
        ):
            self._task = COMMANDS[order.command.verb].task or "holding"
            at = order.command.target or self._terrain.world.base
            self._end(order, "done", f"at {at}", keeps_task=True)

    def _landed_home(self, order: FlightOrder, at: Point) -> None:
        world = self._terrain.world
        if self._at_base():
            self._task = "charging"
            self._end(order, "done", f"at {world.base}", keeps_task=True)
        else:
            away = math.dist(at, world.frames[world.base].at)
            why = f"it landed {away:.0f} m from {world.base}: its home is elsewhere"
            self._end(order, "failed", why)

    # Stopping

    def _stop(self, command: DeviceCommand) -> None:
        """Withdraw the current order and request a hold."""
        self._answers.setdefault(command.command_id, None)
        if self.state.manual:
            mode = self.state.mode
            self._answer(command, "refused", f"a pilot flies it ({mode}) and keeps it")
            return
        old, before = self._order, self._hold
        self._order, self.place, self._task = None, None, "holding"
        if old is not None:
            self._withdraw(old)
            self._answer(old.command, "failed", "superseded")
        again = before is not None and before.command.command_id == command.command_id
        if before is not None and not before.done and not again:
            self._answer(before.command, "failed", "superseded")
        now = self._now()
        if before is not None and before.waits(now):
            self._hold = HoldOrder(command, before.asked_s)
        else:
            self._hold = HoldOrder(command, now)
            self._autopilot.hold()

    def _step_hold(self, now: float) -> None:
        hold, state = self._hold, self.state
        if hold is None:
            return
        if hold.refused is not None:
            problem, since_s = hold.refused
            if now - since_s >= REASON_S:
                self._give_reason(hold.command, problem, since_s, hold.accepted_s is not None)
                self._hold = None
            return
        if hold.asked or hold.accepted_s is None or state.manual or state.parked:
            return
        elsewhere = state.mode != "HOLD" and state.mode_s > hold.accepted_s
        if elsewhere and now - hold.accepted_s > HOLD_S and self._order is None:
            hold.asked, hold.asked_s, hold.accepted_s = True, now, None
            self._autopilot.hold()

    def _end(
        self, order: FlightOrder, status: ReplyStatus, detail: str, *, keeps_task: bool = False
    ) -> None:
        self._order = None
        self._withdraw(order)
        if not keeps_task:
            self._task, self.place = "holding", None
        self._answer(order.command, status, detail)

    def _answer(self, command: DeviceCommand, status: ReplyStatus, detail: str = "") -> None:
        answer = DeviceAnswer(command.command_id, command.agent, status, detail)
        self._answers[command.command_id] = answer
        self._tell(answer)

    def _give_reason(
        self, command: DeviceCommand, problem: str, since_s: float, acknowledged: bool
    ) -> None:
        """Answer a refused command with the reason, and with the vehicle's texts of that time."""
        self._task, self.place = "holding", None
        status: ReplyStatus = "failed" if acknowledged else "refused"
        self._answer(command, status, self._with_words(problem, since_s - REASON_S))

    def _report(self) -> AssetReport:
        fix, state, order = self.state.fix, self.state, self._order
        assert fix is not None
        target = order.target if order is not None else None
        return AssetReport(
            self.agent,
            fix.sent,
            fix.at,
            fix.heading_deg,
            fix.speed_mps,
            state.status,
            self._task if not state.manual else "none",
            state.battery_pct,
            order.command.command_id if order is not None else None,
            state.manual,
            (target,) if target is not None else (),
        )
