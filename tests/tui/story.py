"""A mission told in events, step by step, as a station would tell it."""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta

from pa_console.mission.approval import CheckedPlan, OrderAsRead, approval_state, request_approval
from pa_console.schema.command import CommandReply, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.finding import Finding, RuleOpinion, Usage, Verdict
from pa_console.schema.mission import ActionOutcome, Decision, Metrics, Mission, Verification
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rehearsal import AssetTimeline, GateTimeline, Motion, Rehearsal, Timeline
from pa_console.schema.rule import RuleHit
from pa_console.schema.telemetry import Picture
from pa_console.session.state import SessionState
from tests.tui.site import DIGEST, RULES, WORLD, picture, track

START = datetime(2026, 3, 1, 9, 30, tzinfo=UTC)
MISSION = Mission(id="M-003", text="Have a look at what comes up the north road.", created=START)
PLAN = Plan(
    reason="Unknown vehicle 28 m from NorthGate; Drone_T02 watches it, identify it on the ground.",
    actions=(
        Action(agent="Drone_T04", command="observe NorthGate"),
        Action(agent="Robot_T01", command="identify NorthGate"),
    ),
)
PICTURE = picture(
    tracks=(track(),), changes={"Drone_T04": {"battery_pct": 21.0, "low_battery": True}}
)
STEPS = ("planning", "approval", "executing", "finished")

STARTED = ev.SessionStarted(
    session="20260301-0930",
    version="0.1.0",
    world="checkpoint",
    world_sha256="0" * 64,
    rules="checkpoint",
    rules_sha256="1" * 64,
    model="scripted",
    model_sha256="2" * 64,
    seed=0,
    sampler="greedy",
    grammar_sha256="3" * 64,
)


TAK_UP = ev.TakChanged(
    server="tls://tak.example:8089",
    state="connected",
    detail="connected to tls://tak.example:8089",
)


def reported() -> list[ev.EventPayload]:
    """What others on a TAK server say is around: a unit of theirs, and somebody hostile."""
    unit = ev.ReportedContact(
        uid="ANDROID-1",
        callsign="ALPHA 1",
        affiliation="friend",
        what="ground unit",
        at=(-24.0, 24.0),
        time=START,
        stale=START + timedelta(minutes=5),
    )
    hostile = {"uid": "ANDROID-2", "callsign": "RED 7", "affiliation": "hostile"}
    other = unit.model_copy(update={**hostile, "what": "vehicle", "at": (30.0, 24.0)})
    return [ev.ContactReported(contact=contact) for contact in (unit, other)]


def opening() -> list[ev.EventPayload]:
    """The events before the first mission."""
    return [
        STARTED,
        ev.WorkerChanged(state="ready", detail="scripted"),
        ev.TelemetryReceived(picture=PICTURE),
        ev.Noticed(level="warning", subject="Vehicle_01", text="unknown vehicle near NorthGate"),
        ev.Noticed(level="warning", subject="Drone_T04", text="battery low, 21 %"),
    ]


def findings(broken: tuple[str, ...] = ()) -> tuple[Finding, ...]:
    """A finding for every rule; those named are broken."""
    result: list[Finding] = []
    for rule in RULES:
        status = "violates" if rule.id in broken else "complies" if rule.check else "judged_only"
        message = rule.message if rule.id in broken else ""
        result.append(
            Finding(rule_id=rule.id, priority=rule.priority, status=status, message=message)
        )
    return tuple(result)


def rehearsal() -> Rehearsal:
    """A rehearsal in which nothing goes wrong."""
    gates = {
        gate: GateTimeline(covered_before=True, covered_after=True, longest_gap_s=0.0)
        for gate in WORLD.gates
    }
    assets = {
        "Drone_T04": AssetTimeline(finished=True, least_battery_pct=20.0, travelled_m=31.0),
        "Robot_T01": AssetTimeline(finished=True, least_battery_pct=84.0, travelled_m=44.0),
    }
    timeline = Timeline(duration_s=38.0, gates=gates, assets=assets)
    there = {"at": "NorthGate", "post": "NorthGate"}
    after = picture(
        time_s=338.0,
        tracks=(track(),),
        changes={
            "Drone_T04": {**there, "position": (3.0, 34.0), "battery_pct": 20.0},
            "Robot_T01": {**there, "position": (0.0, 36.0), "battery_pct": 84.0},
        },
    )
    return Rehearsal(before=PICTURE, after=after, timeline=timeline, motion=MOTION)


MOTION = Motion(
    trajectories={
        "Drone_T04": ((0.0, 2.0, 3.0), (6.0, 3.0, 34.0)),
        "Robot_T01": ((0.0, 1.0, -1.0), (4.0, 9.0, 4.0), (31.0, 0.0, 36.0)),
    },
    guards={
        "NorthGate": (
            (0.0, ("Drone_T02",)),
            (6.0, ("Drone_T02", "Drone_T04")),
            (31.0, ("Drone_T02", "Drone_T04", "Robot_T01")),
        )
    },
    arrived_s={"Drone_T04": 6.0, "Robot_T01": 31.0},
    ended_s={"Drone_T04": 7.0, "Robot_T01": 36.0},
)
"""Both come up the north road: the drone straight, the robot round a wall."""


def planning(attempt: int = 1) -> list[ev.EventPayload]:
    """Steps 1 to 5, the answer half streamed."""
    return [
        ev.MissionReceived(mission=MISSION, position=0),
        ev.MissionStarted(),
        ev.RulesRetrieved(
            method="paper",
            hits=(
                RuleHit(rule_id="ROE-01", score=0.21, components={"ratio": 0.31, "jaccard": 0.11},
                        pinned=True),
                RuleHit(rule_id="WF-03", score=0.38, components={"ratio": 0.46, "jaccard": 0.3}),
                RuleHit(rule_id="ROE-02", score=0.35, components={"ratio": 0.44, "jaccard": 0.26}),
            ),
            seconds=0.0012,
        ),
        ev.PictureDigested(digest=DIGEST, seconds=0.0003),
        ev.PromptBuilt(role="planner", attempt=attempt, system="You plan for a checkpoint.",
                       user="Picture: ...\nMission: ...", seconds=0.0001),
        ev.TextStreamed(role="planner", attempt=attempt, text='{"reason": "Unknown vehicle'),
    ]  # fmt: skip


ASKED = "asked: unknown vehicle at NorthGate"


def judged(
    broken: tuple[str, ...] = (),
    verdict: str = "Success",
    blocked: tuple[str, ...] = (),
    *,
    unmet: tuple[str, ...] = (),
    confidence: float | None = None,
    as_chosen: bool = False,
    readings: tuple[str, ...] = (),
) -> list[ev.EventPayload]:
    """Steps 5 and 6 up to the operator's turn."""
    opinions = tuple(
        RuleOpinion(rule_id=rule.id, opinion="complies" if verdict == "Success" else "unclear")
        for rule in RULES[:3]
    )
    good = verdict == "Success"
    read = OrderAsRead(confidence=None if as_chosen else confidence, narrowed=bool(unmet))
    feedback = ("The vehicle is observed and identified before anything else." if good
                else "Nothing shows that the vehicle has to be identified now.")  # fmt: skip
    given = Verdict.model_validate({"verdict": verdict, "rules": opinions, "feedback": feedback})
    usage = Usage(prompt_tokens=612, completion_tokens=48, first_token_s=0.41, seconds=1.3)
    medium = {rule.id for rule in RULES if rule.priority == "medium"}
    return [
        ev.PlanProposed(
            attempt=1,
            text=PLAN.model_dump_json(),
            plan=PLAN,
            usage=usage,
            confidence=confidence,
            as_chosen=as_chosen,
        ),
        ev.PlanRehearsed(attempt=1, rehearsal=rehearsal(), seconds=0.06),
        ev.PlanChecked(attempt=1, findings=findings(broken), seconds=0.003, unmet=unmet),
        ev.PlanJudged(attempt=1, verdict=given, usage=usage),
        ev.ApprovalRequested(
            attempt=1,
            plan=PLAN,
            blocked_by=blocked,
            acknowledge=tuple(name for name in broken if name in medium),
            needs_override=verdict == "Failure",
            asked=ASKED if readings else "",
            readings=readings,
            confidence=read.confidence,
            state=approval_state(
                read, blocked=bool(blocked), objected=not good, warned=not medium.isdisjoint(broken)
            ),
        ),
    ]


def not_understood(text: str) -> list[ev.EventPayload]:
    """An order that is asked back about: no plan was made for it."""
    mission = MISSION.model_copy(update={"text": text})
    question = "not known in English: Drohne, Osttor. What is to be done, in English?"
    return [
        *opening(),
        ev.MissionReceived(mission=mission, position=0),
        ev.MissionStarted(),
        request_approval(
            "M-003.0",
            0,
            CheckedPlan(Plan(reason="", actions=())),
            OrderAsRead(question=question),
        ),
    ]


def asked_back() -> list[ev.EventPayload]:
    """An order that two gates fit: which one is meant is asked, with both to choose from."""
    said = "the uncovered gate"
    question = f"2 gates fit “{said}”. Which one is meant?"
    return [
        *opening(),
        ev.MissionReceived(
            mission=MISSION.model_copy(update={"text": f"Ugv_T02 to {said}."}), position=0
        ),
        ev.MissionStarted(),
        ev.QuestionAsked(question=question, said=said, choices=("SouthGate", "WestGate")),
        request_approval(
            "M-003.0",
            0,
            CheckedPlan(Plan(reason="", actions=())),
            OrderAsRead(question=question),
        ),
    ]


def executing() -> list[ev.EventPayload]:
    """The decision and the first replies."""
    sent = [
        DeviceCommand(command_id=f"c{n}", agent=a.agent, verb=a.verb, target=a.target)
        for n, a in enumerate(PLAN.actions)
    ]
    decision = Decision(kind="approve", acknowledged=("CAP-04",))
    return [
        ev.DecisionMade(attempt=1, decision=decision, accepted=True),
        *(ev.CommandSent(command=command) for command in sent),
        ev.CommandReplied(reply=CommandReply(command_id="c0", agent="Drone_T04", status="done",
                                             tick=3100, detail="at NorthGate")),
        ev.CommandReplied(reply=CommandReply(command_id="c1", agent="Robot_T01",
                                             status="progress", tick=3120)),
        ev.TelemetryReceived(picture=moving_picture()),
    ]  # fmt: skip


def moving_picture() -> Picture:
    """The robot under way, a gate lost, a drone down."""
    return picture(
        time_s=312.0,
        tracks=(track(), track("Person_02", "EastGate", kind="person", position=(75.0, 0.0),
                               identity="authorized")),
        uncovered=("SouthGate",),
        changes={
            "Drone_T03": {"status": "failed", "task": "none", "available": False,
                          "stamp_s": 299.0},
            "Drone_T04": {"position": (5.0, 30.0), "at": "NorthGate", "post": "NorthGate",
                          "task": "observing", "battery_pct": 20.0, "low_battery": True},
            "Robot_T01": {"position": (8.0, 8.0), "at": None, "post": "NorthGate",
                          "task": "identifying", "heading_deg": 60.0,
                          "route": ((9.0, 20.0), (2.0, 32.0))},
            "Ugv_T02": {"comms": "degraded"},
        },
    )  # fmt: skip


def finished() -> list[ev.EventPayload]:
    """Verification, report and end."""
    done = tuple(
        ActionOutcome(agent=a.agent, command=a.command, outcome="pass", reason="seen there")
        for a in PLAN.actions
    )
    return [
        ev.CommandReplied(reply=CommandReply(command_id="c1", agent="Robot_T01", status="done",
                                             tick=3400, detail="vehicle is unauthorized")),
        ev.MissionVerified(verification=Verification(outcome="pass", actions=done), seconds=0.001),
        ev.OutcomeJudged(verdict=Verdict(verdict="Success", feedback="The vehicle is known now.")),
        ev.MissionReported(text="Vehicle_01 at NorthGate was identified: unauthorized."),
        ev.MissionFinished(
            status="verified", reason="all actions seen, every gate stayed covered",
            metrics=Metrics(retrieval_s=0.001, first_token_s=0.41, planning_s=1.3, checks_s=0.003,
                            rehearsal_s=0.06, judging_s=1.1, decision_s=4.2, execution_s=38.0,
                            end_to_end_s=46.0, attempts=1)),
    ]  # fmt: skip


def told(upto: str, **options: object) -> list[ev.EventPayload]:
    """Everything up to and including one of STEPS; `options` are those of `judged`."""
    parts = {
        "planning": planning(),
        "approval": judged(**options),  # pyright: ignore[reportArgumentType]
        "executing": executing(),
        "finished": finished(),
    }
    result = opening()
    for name in STEPS[: STEPS.index(upto) + 1]:
        result += parts[name]
    return result


def stamped(payloads: list[ev.EventPayload]) -> Iterator[ev.Event]:
    """Give the payloads fixed times, one second apart."""
    seen = False
    for count, data in enumerate(payloads):
        seen = seen or data.kind == "mission_received"
        session_wide = data.kind in ("telemetry", "noticed", "worker", "session_started")
        yield ev.Event(
            t=START + timedelta(seconds=count),
            tick=3000 + count * 10,
            mission=MISSION.id if seen and not session_wide else None,
            data=data,
        )


def folded(payloads: list[ev.EventPayload]) -> SessionState:
    """The session after these payloads."""
    state = SessionState()
    for event in stamped(payloads):
        state.apply(event)
    return state
