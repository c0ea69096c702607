"""A fixed world, rulebook and picture for the screens; no simulator and no model."""

from collections.abc import Mapping
from pathlib import Path

from pa_console.policy.retriever import Retriever
from pa_console.schema.document import Document
from pa_console.schema.rule import Rule, RuleExample, RuleHit, RulesSeal
from pa_console.schema.telemetry import (
    AssetTelemetry,
    CameraReport,
    Digest,
    GateCover,
    Picture,
    Track,
)
from pa_console.schema.world import World
from pa_console.tui.surroundings import InForce

WORLD = Document.read(Path(__file__).with_name("site.yaml")).parse(World)

RULES = (
    Rule(
        id="ROE-01",
        domain="ROE",
        priority="critical",
        text="Do not use lethal or violent force unless hostile intent is confirmed.",
        tags=("force",),
    ),
    Rule(
        id="ROE-02",
        domain="ROE",
        priority="critical",
        text="Unknown vehicles or persons must be identified before escalation.",
        tags=("vehicle", "identify"),
        applies="size(tracks) > 0",
        check="tracks.all(t, t.identity != 'unknown')",
        message="a track is blocked before it is identified",
        examples=(
            RuleExample(name="identified first", expect="pass", plan=(("Robot_T01", "report"),)),
            RuleExample(
                name="blocked unseen", expect="fail", plan=(("Ugv_T01", "block EastGate"),)
            ),
        ),
    ),
    Rule(
        id="WF-03",
        domain="WF",
        priority="high",
        text="Maintain at least one asset assigned to each gate at all times.",
        tags=("coverage", "gate"),
        check="world.gates.all(g, after.gates[g].covered)",
        message="a gate is left without cover",
    ),
    Rule(
        id="WF-09",
        domain="WF",
        priority="medium",
        text="After incident resolution, generate a brief report.",
    ),
    Rule(
        id="CAP-01",
        domain="CAP",
        priority="high",
        text="UAVs are restricted to observation and reconnaissance.",
        check="plan.actions.all(a, a.kind != 'uav' || a.verb != 'block')",
        message="a UAV is given another task",
    ),
    Rule(
        id="CAP-04",
        domain="CAP",
        priority="medium",
        text="Low-battery assets must return to base or be replaced.",
        check="true",
        message="Drone_T04 has 21 % and is not sent to base",
    ),
)


SEAL = RulesSeal(version="3", content_sha256="5ea1" * 16)


RULEBOOK = InForce("site", SEAL, RULES, {})
"""The rules, as the console sees them."""


class WordRetriever(Retriever):
    """Scores a rule by the share of the text's words that it contains."""

    def __init__(self) -> None:
        super().__init__(RULES)

    def score_all(self, text: str) -> tuple[RuleHit, ...]:
        """Score every rule."""
        words = set(text.lower().split())
        return tuple(
            RuleHit(rule_id=rule.id, score=score, components={"words": score})
            for rule in RULES
            for score in [len(words & set(rule.text.lower().split())) / len(words)]
        )


_PLACES = {
    "Drone_T01": ((-53.0, 1.0), 180.0, "WestGate"),
    "Drone_T02": ((1.0, 33.0), 90.0, "NorthGate"),
    "Drone_T03": ((0.0, -33.0), 270.0, "SouthGate"),
    "Drone_T04": ((2.0, 3.0), 45.0, "Checkpoint"),
    "Ugv_T01": ((53.0, 0.0), 0.0, "EastGate"),
    "Ugv_T02": ((-3.0, -2.0), 0.0, "Checkpoint"),
    "Robot_T01": ((1.0, -1.0), 135.0, "Checkpoint"),
    "Robot_T02": ((40.0, -26.0), 180.0, "Base"),
}
_TASKS = {"Checkpoint": "holding", "Base": "charging"}


def asset(name: str, time_s: float = 300.0, **changes: object) -> AssetTelemetry:
    """One asset at its post; `changes` are fields of AssetTelemetry."""
    position, heading, post = _PLACES[name]
    fields: dict[str, object] = {
        "id": name,
        "kind": WORLD.assets[name].kind,
        "at": post,
        "post": post,
        "position": position,
        "heading_deg": heading,
        "speed_mps": 0.0,
        "status": "ok",
        "task": _TASKS.get(post, "observing"),
        "battery_pct": 87.0,
        "low_battery": False,
        "comms": "ok",
        "available": True,
        "stamp_s": time_s - 0.4,
    }
    return AssetTelemetry.model_validate(fields | changes)


def picture(
    time_s: float = 300.0,
    changes: Mapping[str, Mapping[str, object]] | None = None,
    tracks: tuple[Track, ...] = (),
    uncovered: tuple[str, ...] = (),
    **fields: object,
) -> Picture:
    """The default picture at `time_s` with some assets changed and some gates uncovered.

    `fields` are further fields of Picture.
    """
    changes = changes or {}
    assets = {name: asset(name, time_s, **changes.get(name, {})) for name in _PLACES}
    covers = {gate: [n for n, a in assets.items() if a.at == gate] for gate in WORLD.gates}
    gates = {
        gate: GateCover(
            covered=gate not in uncovered,
            by=() if gate in uncovered else tuple(by),
            uncovered_s=12.0 if gate in uncovered else 0.0,
        )
        for gate, by in covers.items()
    }
    given: dict[str, object] = {
        "tick": round(time_s * 10),
        "time_s": time_s,
        "assets": assets,
        "tracks": {track.id: track for track in tracks},
        "gates": gates,
        "cameras": {
            name: CameraReport(gate=camera.gate, works=True, stamp_s=time_s - 0.3)
            for name, camera in WORLD.cameras.items()
        },
    }
    return Picture.model_validate(given | fields)


def track(name: str = "Vehicle_01", gate: str = "NorthGate", **changes: object) -> Track:
    """An unknown vehicle north of the site."""
    fields: dict[str, object] = {
        "id": name,
        "kind": "vehicle",
        "gate": gate,
        "position": (1.0, 62.0),
        "heading_deg": 270.0,
        "speed_mps": 5.0,
        "distance_m": 28.0,
        "observed_by": ("Drone_T02",),
        "observed": True,
        "stamp_s": 299.6,
    }
    return Track.model_validate(fields | changes)


DIGEST = Digest(
    covered={"NorthGate": 1, "EastGate": 1, "SouthGate": 1, "WestGate": 1},
    uncovered=(),
    free={"uav": ("Drone_T04",), "ugv": ("Ugv_T02",), "robot": ("Robot_T01", "Robot_T02")},
    sole_cover={"NorthGate": "Drone_T02", "EastGate": "Ugv_T01"},
    posts={"Drone_T04": "uav at Checkpoint, holding"},
    down=(),
    low_battery=("Drone_T04",),
    tracks=("Vehicle_01: unknown vehicle, 28 m from NorthGate, approaching",),
)
