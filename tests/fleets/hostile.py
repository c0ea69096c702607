"""Messages that no station may believe, drawn from the true ones that a site sends."""

import json
from datetime import datetime, timedelta
from random import Random
from typing import Any, cast

NAMES = (
    "Drone_T01", "Ugv_T01", "NorthCamera", "site", "trust", "Nobody", "station", "__class__",
    "x" * 64,
)  # fmt: skip
TOPICS = (
    "state", "connection", "factsheet", "detections", "site", "clockDone", "incidentDone", "told",
    "order", "roster", "revocation", "takeover", "records", "recordsAsked", "countersignature",
    "nonsense",
)  # fmt: skip
WRONG: tuple[Any, ...] = (
    None, True, -1, 2**70, 1e308, "", "x" * 3000, [], {}, [[[[]]]], {"a": {"b": []}}, "\x1b]52;c;A",
)  # fmt: skip
GARBAGE = (
    b"", b"null", b"[]", b"{", b"\xff\x00\xfe", b"NaN", b"[" * 100_000, b'{"headerId": 1e999}',
    b" " * 300_000, b"x" * 300_000, b'"' + b"\\u0000" * 50 + b'"',
)  # fmt: skip
READ = {
    "state": (
        "orderId", "nodeStates", "edgeStates", "driving", "actionStates", "instantActionStates",
        "powerSupply", "operatingMode", "errors", "safetyState", "lastNodeId",
    ),
    "connection": ("connectionState",),
    "factsheet": ("typeSpecification", "physicalParameters", "protocolFeatures"),
    "detections": ("contacts", "team", "works"),
}  # fmt: skip
HEADER = ("headerId", "timestamp", "version", "manufacturer", "serialNumber")


def draw(random: Random, heard: dict[str, bytes]) -> tuple[str, bytes]:
    """Return (topic, payload) of one message; `heard` are true messages by topic."""
    topics = [topic for topic in heard if topic.rsplit("/", 1)[1] in READ]
    topic = random.choice(topics)
    parts = topic.split("/")
    kind = random.randrange(8)
    if kind == 0:
        return topic, random.choice(GARBAGE)
    if kind == 1:
        return topic, random.randbytes(random.randrange(200))
    if kind == 2:
        elsewhere = "/".join((*parts[:3], random.choice(NAMES), random.choice(TOPICS)))
        return elsewhere, random.choice((*GARBAGE, heard[topic]))
    message = cast("dict[str, Any]", json.loads(heard[topic]))
    if kind == 3:
        message.pop(random.choice((*HEADER, *_present(parts[-1], message))), None)
    elif kind == 4:
        message[random.choice(HEADER[1:])] = random.choice(WRONG)
    elif kind == 5:
        message[random.choice(("manufacturer", "serialNumber"))] = random.choice(NAMES)
    elif kind == 6:
        sent = datetime.fromisoformat(message["timestamp"])
        moved = sent + timedelta(seconds=random.choice((-3600.0, -5.0, 5.0, 3600.0, 1e8)))
        message["timestamp"] = moved.isoformat()
        if parts[-1] not in ("state", "detections"):
            message["version"] = "2.0.0"
    else:
        message["version"] = random.choice(("2.1.0", "4.0.0", "", "v3", "\u0663.0.0"))
    return topic, json.dumps(message).encode()


def _present(topic: str, message: dict[str, Any]) -> tuple[str, ...]:
    required = [field for field in READ[topic] if field in message]
    return tuple(field for field in required if topic != "detections" or field == "nothing")


EXTREMES = (0.0, -0.0, 1e-300, 1.0, -1.0, 1e5, -1e5, 1e7, -1e7)
SECONDS = (0.0, 0.0, 0.0, -0.4, 0.4, -3.0, 3.0, -20.0, 60.0, -3600.0, 3600.0, -6e10, 2e11)


def absurd(random: Random, heard: dict[str, bytes], now: datetime) -> tuple[str, bytes]:
    """Return (topic, payload) of a message that is well formed and says what cannot be."""
    topics = [topic for topic in heard if topic.rsplit("/", 1)[1] in READ]
    topic = random.choice(topics)
    name = topic.rsplit("/", 1)[1]
    message = cast("dict[str, Any]", json.loads(heard[topic]))
    if name in ("state", "detections") and random.random() < 0.5:
        other = "detections" if name == "state" else "state"
        found = [each for each in heard if each.endswith(f"/{other}")]
        topic = random.choice(found or [topic])
        name, message = topic.rsplit("/", 1)[1], json.loads(heard[topic])
    if name == "detections":
        message |= {
            "works": random.random() < 0.9,
            "contacts": [_contact(random) for _ in range(random.choice((0, 1, 2, 5, 50, 300)))],
            "team": [_teammate(random) for _ in range(random.choice((0, 1, 8, 100)))],
        }
    elif name == "state":
        _twist(random, message)
    message["headerId"] = random.choice((0, 1, 2**62, message["headerId"]))
    message["timestamp"] = _moment(random, now)
    return topic, json.dumps(message).encode()


def _moment(random: Random, now: datetime) -> str:
    try:
        return (now + timedelta(seconds=random.choice(SECONDS))).isoformat()
    except OverflowError:
        return "9999-12-31T23:59:59.999Z"


def _contact(random: Random) -> dict[str, Any]:
    at = {"x": random.choice(EXTREMES), "y": random.choice(EXTREMES)}
    return {
        "signature": random.choice(("a", "b", "", f"c{random.randrange(10_000)}")),
        "kind": random.choice(("vehicle", "person")),
        "sigmaM": abs(random.choice(EXTREMES[:6])),
        "identity": random.choice(("unknown", "authorized", "unauthorized")),
        "opinion": random.choice(("unknown", "benign", "hostile")),
        "noncombatants": random.random() < 0.5,
        **(at if random.random() < 0.8 else {}),
        **({"warnedS": random.choice((0.0, 1.0, 1e5))} if random.random() < 0.3 else {}),
    }


def _teammate(random: Random) -> dict[str, Any]:
    name = random.choice(("Drone_T01", "Ugv_T01", "Robot_T01", "Nobody_T99"))
    return {"name": name, "x": random.choice(EXTREMES), "y": random.choice(EXTREMES)}


def _twist(random: Random, state: dict[str, Any]) -> None:
    """Change some of what a robot reports of itself to what is allowed and cannot be."""
    node = {"nodeId": random.choice(("EastGate", "", "x" * 128)), "sequenceId": 2**62,
            "released": True, "nodePosition": {"x": 1e7, "y": -1e7, "mapId": ""}}  # fmt: skip
    action = {
        "actionId": random.choice(("", "c1", "x" * 128)),
        "actionType": random.choice(("move_to", "hold", "", "explode")),
        "actionStatus": random.choice(("WAITING", "RUNNING", "FINISHED", "FAILED", "RETRIABLE")),
        "actionResult": random.choice(("", "\x1b[2J", "x" * 2000)),
    }
    error = {"errorType": "x", "errorLevel": random.choice(("WARNING", "URGENT", "FATAL")),
             "errorReferences": [{"referenceKey": "actionId", "referenceValue": "c1"}],
             "errorDescription": "\u202e" * 100}  # fmt: skip
    twists: dict[str, Any] = {
        "nodeStates": [node] * random.choice((0, 1, 1000)),
        "actionStates": [action] * random.choice((0, 1, 300)),
        "instantActionStates": [action] * random.choice((0, 1, 300)),
        "errors": [error] * random.choice((0, 1, 300)),
        "driving": random.random() < 0.5,
        "paused": random.random() < 0.5,
        "orderId": random.choice(("", "c1", "x" * 128)),
        "operatingMode": random.choice(("AUTOMATIC", "MANUAL", "STARTUP", "TEACH_IN")),
        "powerSupply": {"stateOfCharge": random.choice((0.0, 100.0, 1e-300)), "charging": True},
        "velocity": {"vx": random.choice(EXTREMES), "vy": random.choice(EXTREMES)},
        "mobileRobotPosition": {
            "x": random.choice(EXTREMES), "y": random.choice(EXTREMES),
            "theta": random.choice((-3.14159, 0.0, 3.14159)), "mapId": "site",
            "localized": random.random() < 0.8,
        },
        "information": [{"infoType": "task", "infoDescriptor": random.choice(("moving", "x"))}],
    }  # fmt: skip
    for field in random.sample(sorted(twists), random.randrange(1, 6)):
        state[field] = twists[field]
