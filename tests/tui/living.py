"""A living checkpoint told in events: alarms, a queue, a workflow, a halted plan, old reports."""

from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Verdict
from pa_console.schema.mission import (
    ActionOutcome,
    Alarm,
    Decision,
    Mission,
    QueueEntry,
    Verification,
)
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import CameraReport, GateCover, Picture, Selection
from tests.tui import story
from tests.tui.site import DIGEST, WORLD, asset, picture, track

HOSTILE = Alarm(
    id="hostile_track:Track_04", kind="hostile_track", priority="emergency", subject="Track_04",
    gate="EastGate", text="Track_04 is hostile, two sensors agree, near EastGate",
    command="Keep everybody away from EastGate and block it against Track_04.",
    raised_s=296.0, distance_m=41.0,
)  # fmt: skip
UNKNOWN = Alarm(
    id="unknown_track:Track_01", kind="unknown_track", priority="high", subject="Track_01",
    gate="NorthGate", text="an unknown vehicle approaches NorthGate",
    command="Look at the vehicle at NorthGate and find out whose it is.",
    raised_s=281.0, distance_m=28.0,
)  # fmt: skip
BATTERY = Alarm(
    id="low_battery:Drone_T04", kind="low_battery", priority="low", subject="Drone_T04",
    text="Drone_T04 has 21 % left", command="Send Drone_T04 to base.", raised_s=260.0,
)  # fmt: skip
ALARMS = (BATTERY, UNKNOWN, HOSTILE)


def waiting(number: int, alarm: Alarm, reason: str) -> QueueEntry:
    """The mission that answers `alarm`, as it waits."""
    mission = Mission(
        id=f"M-{number:03}", text=alarm.command, source="alarm", created=story.START,
        alarm=alarm.id, subject=alarm.subject, gate=alarm.gate,
    )  # fmt: skip
    return QueueEntry(
        mission=mission, priority=alarm.priority, distance_m=alarm.distance_m, reason=reason
    )


QUEUE = (
    waiting(4, HOSTILE, "WF-04: a confirmed threat goes first"),
    waiting(5, BATTERY, "WF-05: waits until the active mission is over"),
)


def seen_picture(time_s: float = 300.0) -> Picture:
    """Two tracks, an old report, a silent asset, a forged one, a failed camera, fog."""
    cameras = {
        name: CameraReport(gate=camera.gate, works=name != "WestCamera", stamp_s=time_s - 0.3)
        for name, camera in WORLD.cameras.items()
    }
    shown = picture(
        time_s,
        tracks=(
            track("Track_01", seen_by=("Drone_T02",), uncertainty_m=1.4),
            track("Track_04", "EastGate", position=(95.0, 2.0), identity="unauthorized",
                  intent="hostile", hostile_by=("Ugv_T01", "EastCamera"), distance_m=41.0,
                  warned=True, defiant=True),
            track("Track_02", "SouthGate", kind="person", position=(-2.0, -52.0),
                  stamp_s=time_s - 9.0, stale=True, uncertainty_m=12.0, distance_m=18.0),
        ),
        changes={
            "Drone_T01": {"stamp_s": time_s - 7.0, "stale": True, "available": False},
            "Robot_T02": {"stamp_s": time_s - 22.0, "stale": True, "comms": "lost",
                          "available": False},
            "Ugv_T02": {"integrity": "suspect", "available": False},
            "Drone_T04": {"battery_pct": 21.0, "low_battery": True},
        },
        cameras=cameras,
        weather="fog",
    )  # fmt: skip
    unsure = {"WestGate": GateCover(covered=False, uncovered_s=4.0, unsure=("Drone_T01",))}
    return shown.model_copy(update={"gates": {**shown.gates, **unsure}})


STARTED = story.STARTED.model_copy(update={"scenario": "situation-1"})


def troubled() -> list[ev.EventPayload]:
    """The session up to now: alarms of all kinds, nothing decided."""
    return [
        STARTED,
        ev.WorkerChanged(state="ready", detail="scripted"),
        ev.TelemetryReceived(picture=seen_picture()),
        *(ev.AlarmRaised(alarm=alarm) for alarm in ALARMS),
        ev.AlarmAcknowledged(alarm_id=BATTERY.id),
    ]


def alarmed() -> list[ev.EventPayload]:
    """A mission under way while alarms are open and their missions wait."""
    telemetry = ev.TelemetryReceived(picture=seen_picture())
    return [
        *troubled(),
        *story.planning(),
        *story.judged()[:-1],
        ev.QueueChanged(entries=QUEUE),
        telemetry,
    ]


def move(phase: int, **fields: object) -> ev.WorkflowMoved:
    """Where the mission stands with Track_01."""
    given = {
        "workflow": "threat", "rule_id": "WF-01", "track": "Track_01", "phase": phase,
        "phases": ("recon", "identify", "warn", "escalate"),
    }  # fmt: skip
    return ev.WorkflowMoved.model_validate(given | fields)


RECON = Plan(
    reason="Nobody has seen it from the air yet.",
    actions=(Action(agent="Drone_T04", command="observe NorthGate"),),
)
IDENTIFY = Plan(
    reason="It was seen; a ground robot finds out whose it is.",
    actions=(Action(agent="Robot_T01", command="identify NorthGate"),),
)


def plan(number: int, given: Plan, outcome: str, reason: str) -> list[ev.EventPayload]:
    """One phase from its plan to the judge's verdict on its outcome."""
    action = given.actions[0]
    command = DeviceCommand(
        command_id=f"p{number}", agent=action.agent, verb=action.verb, target=action.target
    )
    shown = ActionOutcome.model_validate(
        {"agent": action.agent, "command": action.command, "outcome": outcome, "reason": reason}
    )
    verification = Verification.model_validate(
        {"outcome": outcome, "actions": (shown,), "as_of_s": 300.0 + number, "reason": reason,
         "gates_unknown": () if outcome == "pass" else ("WestGate",)}
    )  # fmt: skip
    done = CommandReply(command_id=f"p{number}", agent=action.agent, status="done", tick=3200)
    return [
        *story.judged()[1:-1],
        ev.PlanProposed(attempt=number, text=given.model_dump_json(), plan=given),
        ev.ApprovalRequested(attempt=number, plan=given, state="approve"),
        ev.DecisionMade(attempt=number, decision=Decision(kind="approve"), accepted=True),
        ev.CommandSent(command=command),
        ev.CommandResent(command_id=f"p{number}", times=2),
        ev.CommandReplied(reply=done),
        ev.MissionVerified(verification=verification, seconds=0.001),
        ev.OutcomeJudged(verdict=Verdict(verdict="Success", feedback="It is known now.")),
    ]


SELECTION = Selection(
    gates={"NorthGate": "the mission is about it"},
    tracks={"Track_01": "the mission is about it"},
    assets={"Drone_T04": "nearest spare", "Robot_T01": "can identify"},
    left_out={"gates": 3, "tracks": 1, "assets": 6},
)


def workflow() -> list[ev.EventPayload]:
    """Two phases behind it, the third being planned."""
    digested = ev.PictureDigested(
        digest=DIGEST.model_copy(update={"selection": SELECTION, "unknown": ("WestGate: cover",)}),
        seconds=0.0003,
    )
    started = [*story.planning()[:2], move(0), *story.planning()[2:3], digested]
    return [
        *troubled(),
        *started,
        *plan(1, RECON, "pass", "seen there"),
        move(1),
        digested,
        *plan(2, IDENTIFY, "unknown", "the last report of Robot_T01 is 7 s old"),
        move(2, command="Warn the vehicle at NorthGate."),
        digested,
        *story.planning(3)[4:],
    ]


def halted() -> list[ev.EventPayload]:
    """A plan that was stopped because the covering asset failed, and its replacement."""
    failed = asset("Drone_T02", status="failed", available=False).model_dump()
    down = picture(305.0, changes={"Drone_T02": failed}, uncovered=("NorthGate",))
    return [
        *story.told("executing")[:-1],
        ev.TelemetryReceived(picture=down),
        ev.PlanHalted(
            attempt=1,
            reasons=("Drone_T02, which covers NorthGate, has failed",),
            safe_state=("Robot_T01 hold", "Drone_T04 move_to NorthGate"),
        ),
        *story.planning(2)[4:],
    ]


def stopped() -> list[ev.EventPayload]:
    """Everything was stopped; one asset has not confirmed it."""
    orders = [
        DeviceCommand(command_id=f"stop1.{number}", agent=name, verb="hold")
        for number, name in enumerate(WORLD.assets, start=1)
    ]
    return [
        *troubled(),
        ev.AllStopped(by="operator"),
        *(ev.CommandSent(command=order) for order in orders),
        *(
            ev.CommandReplied(
                reply=CommandReply(
                    command_id=order.command_id, agent=order.agent, status="done", tick=3100
                )
            )
            for order in orders[1:]
        ),
    ]
