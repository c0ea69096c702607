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
