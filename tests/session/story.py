"""A small session, event by event, as the tests of log, fold and replay need it."""

from datetime import UTC, datetime, timedelta

from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.incident import SpawnTrack
from pa_console.schema.mission import Decision, Metrics, Mission
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import GateCover, Picture

START = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)
PLAN = Plan(reason="look at the gate", actions=(Action(agent="Uav_1", command="observe GateA"),))


def at(seconds: float, data: ev.EventPayload, mission: str | None = None) -> ev.Event:
    """An event `seconds` after the start of the session."""
    moment = START + timedelta(seconds=seconds)
    return ev.Event(t=moment, tick=int(seconds * 10), mission=mission, data=data)


def telemetry(seconds: float) -> ev.Event:
    """The picture of `seconds` after the start; GateA is covered in every other one."""
    tick = int(seconds * 10)
    gates = {"GateA": GateCover(covered=tick % 2 == 0)}
    picture = Picture(tick=tick, time_s=seconds, assets={}, gates=gates)
    return at(seconds, ev.TelemetryReceived(picture=picture))


def session_started(session: str = "S1") -> ev.SessionStarted:
    """The event that opens every log."""
    return ev.SessionStarted(
        session=session,
        version="0",
        world="w",
        world_sha256="",
        rules="r",
        rules_sha256="",
        model="m",
        model_sha256="",
        seed=0,
        sampler="greedy",
        grammar_sha256="",
    )


def story() -> list[ev.Event]:
    """One mission from intake to its end, with telemetry in between and streamed text."""
    mission = Mission(id="M1", text="watch gate A – now", created=START)
    command = DeviceCommand(command_id="c1", agent="Uav_1", verb="observe", target="GateA")
    done = CommandReply(command_id="c1", agent="Uav_1", status="done", tick=70)
    return [
        at(0.0, session_started()),
        telemetry(0.5),
        at(0.7, ev.IncidentHappened(incident=SpawnTrack(gate="GateA"))),
        at(1.0, ev.MissionReceived(mission=mission, position=0), "M1"),
        at(1.0, ev.MissionStarted(), "M1"),
        at(1.2, ev.TextStreamed(role="planner", attempt=1, text='{"rea'), "M1"),
        telemetry(1.3),
        at(1.4, ev.PlanProposed(attempt=1, text="{}", plan=PLAN), "M1"),
        at(1.5, ev.ApprovalRequested(attempt=1, plan=PLAN), "M1"),
        telemetry(2.0),
        at(
            5.0,
            ev.DecisionMade(attempt=1, decision=Decision(kind="approve"), accepted=True),
            "M1",
        ),
        at(5.0, ev.CommandSent(command=command), "M1"),
        telemetry(6.1),
        at(7.0, ev.CommandReplied(reply=done), "M1"),
        at(8.0, ev.MissionFinished(status="verified", reason="done", metrics=Metrics()), "M1"),
        telemetry(8.5),
        at(9.0, ev.SessionEnded(reason="quit")),
    ]
