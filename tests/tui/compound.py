"""A compound order in events: drones go east, a vehicle west, one stays, a gate is lost."""

from pa_console.schema.events import event as ev
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import (
    AssetTimeline,
    GateTimeline,
    Motion,
    Rehearsal,
    RehearsedReading,
    Timeline,
)
from tests.tui import story
from tests.tui.site import WORLD, picture

MISSION = story.MISSION.model_copy(
    update={"text": "Two drones to the east gate, a vehicle to the west gate, the rest stays."}
)
PLAN = Plan(
    reason="asked: 2 drones to EastGate; 1 vehicle to WestGate",
    actions=(
        Action(agent="Drone_T04", command="move_to EastGate"),
        Action(agent="Drone_T02", command="move_to EastGate"),
        Action(agent="Ugv_T02", command="move_to WestGate"),
        Action(agent="Robot_T01", command="hold"),
    ),
)
MOTION = Motion(
    trajectories={
        "Drone_T04": ((0.0, 2.0, 3.0), (5.0, 51.0, 3.0)),
        "Drone_T02": ((0.0, 1.0, 33.0), (8.0, 54.0, -3.0)),
        "Ugv_T02": ((0.0, -3.0, -2.0), (6.0, -15.0, -8.0), (15.0, -52.0, -3.0)),
    },
    guards={
        "NorthGate": ((0.0, ("Drone_T02",)), (1.0, ())),
        "EastGate": (
            (0.0, ("Ugv_T01",)),
            (5.0, ("Drone_T04", "Ugv_T01")),
            (8.0, ("Drone_T02", "Drone_T04", "Ugv_T01")),
        ),
        "WestGate": ((0.0, ("Drone_T01",)), (15.0, ("Drone_T01", "Ugv_T02"))),
    },
    arrived_s={"Drone_T04": 5.0, "Drone_T02": 8.0, "Ugv_T02": 15.0},
    ended_s={"Drone_T04": 6.0, "Drone_T02": 9.0, "Ugv_T02": 16.0, "Robot_T01": 0.2},
)
LEFT = "NorthGate would be left without cover for 17 s"
UNMET = ("1 drone to SouthGate: no other drone is free",)


def rehearsal() -> Rehearsal:
    """The rehearsal of the plan, in which the north gate loses its only guard."""
    gates = {
        gate: GateTimeline(
            covered_before=True, covered_after=gate != "NorthGate",
            longest_gap_s=17.0 if gate == "NorthGate" else 0.0,
        )
        for gate in WORLD.gates
    }  # fmt: skip
    ends = {"Drone_T04": 85.0, "Drone_T02": 84.0, "Ugv_T02": 86.4, "Robot_T01": 87.0}
    assets = {
        name: AssetTimeline(finished=True, least_battery_pct=left) for name, left in ends.items()
    }
    after = picture(
        time_s=318.0,
        uncovered=("NorthGate",),
        changes={
            name: {"position": MOTION.trajectories[name][-1][1:], "at": gate, "post": gate}
            for name, gate in (
                ("Drone_T04", "EastGate"), ("Drone_T02", "EastGate"), ("Ugv_T02", "WestGate"),
            )
        },
    )  # fmt: skip
    return Rehearsal(
        before=picture(),
        after=after,
        timeline=Timeline(duration_s=18.0, gates=gates, assets=assets),
        motion=MOTION,
    )


def reading() -> RehearsedReading:
    """The same as what another reading would lead to, which nobody could approve."""
    return RehearsedReading(plan=PLAN, rehearsal=rehearsal(), faults=(f"WF-03: {LEFT}",))


def told(*, unmet: tuple[str, ...] = UNMET, confidence: float = 0.83) -> list[ev.EventPayload]:
    """Everything up to the operator's turn."""
    result: list[ev.EventPayload] = []
    for data in story.told("approval", unmet=unmet, confidence=confidence):
        match data:
            case ev.PlanProposed() | ev.ApprovalRequested():
                result.append(data.model_copy(update={"plan": PLAN}))
            case ev.PlanRehearsed():
                result.append(data.model_copy(update={"rehearsal": rehearsal()}))
            case ev.MissionReceived():
                result.append(data.model_copy(update={"mission": MISSION}))
            case _:
                result.append(data)
    return result
