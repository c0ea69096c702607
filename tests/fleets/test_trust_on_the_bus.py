"""Roster, revocations and takeovers reach everybody over the bus; nothing else changes them."""

import json
import time
from collections.abc import Callable
from contextlib import closing
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from pa_console.fleets import authorization as auth
from pa_console.fleets.station_authority import Keys, StationAuthority, Vehicles
from pa_console.fleets.vda5050.additions import SIGNED
from pa_console.fleets.vda5050.broker import BrokerAddress
from pa_console.fleets.vda5050.mqtt_fleet import MqttFleet
from pa_console.fleets.vda5050.station_link import join
from pa_console.schema.events.event import Noticed
from pa_console.schema.world import World
from tests.fleets.conftest import joined, running
from tests.fleets.intruder import Intruder, intruder
from tests.fleets.keyring import (
    KEYS,
    PUBLIC,
    REVOCATION,
    ROSTER,
    SIGNED_ROSTER,
    TO_NORTH,
    TO_SOUTH,
    Clock,
)

LIMIT_S = 300.0
NEWER = auth.sign_roster(
    KEYS["owner"], auth.Roster(2, ROSTER.people, ROSTER.stations, ROSTER.rules)
)
REVOKED_TOO = auth.sign_revocation(
    KEYS["owner"], 2, [PUBLIC[name] for name in ("gone", "lost", "bob")]
)
TRUE = {
    "roster": (SIGNED_ROSTER, NEWER),
    "revocation": (REVOCATION, REVOKED_TOO),
    "takeover": (TO_NORTH, TO_SOUTH),
}
FALSE = (
    auth.sign_roster(KEYS["eve"], auth.Roster(9)),
    auth.sign_revocation(KEYS["cleo"], 9, [PUBLIC["cleo"]]),
    auth.sign_takeover(KEYS["ann"], "ann", 9, PUBLIC["lost"]),
    auth.sign_takeover(KEYS["eve"], "cleo", 9, PUBLIC["lost"]),
    TO_SOUTH[:-2] + "AA",
    "",
    "a.b.c",
    "\u2603" * 10,
    "x" * 70_000,
)
POOL = (*(message for pair in TRUE.values() for message in pair), *FALSE)


@given(st.lists(st.sampled_from(POOL), max_size=20), st.randoms(use_true_random=False))
def test_whatever_comes_in_whatever_order_the_newest_that_is_true_holds(
    heard: list[str], random: Random
) -> None:
    expected = auth.Verifier("Ugv_T01", PUBLIC["owner"])
    for kind, (older, newer) in TRUE.items():
        if found := [message for message in (older, newer) if message in heard]:
            assert kind == "takeover" or expected.take(found[-1]) == ""
            expected.take(found[-1])
    verifier = auth.Verifier("Ugv_T01", PUBLIC["owner"])
    signed = auth.SignedMessages(verifier.take)
    for message in heard:
        signed.hear(message)
    told, right = verifier.trust, expected.trust
    assert (told.roster, told.revoked) == (right.roster, right.revoked)
    assert told.takeover == right.takeover


def station(name: str, clock: Clock) -> StationAuthority:
    keys = Keys(KEYS[name], "ann", KEYS["ann"], PUBLIC["owner"], (SIGNED_ROSTER, TO_NORTH))
    return StationAuthority(keys)


def lines(fleet: MqttFleet, steps: int = 1) -> list[str]:
    told = [line for _ in range(steps) for line in fleet.step().told]
    return [line.text for line in told if isinstance(line, Noticed) and line.subject == "keys"]


def topic(evil: Intruder, kind: str) -> str:
    return evil.topic("trust", kind)


def test_a_takeover_on_the_bus_reaches_the_vehicles_and_the_old_station(
    world: World, address: BrokerAddress
) -> None:
    clock = Clock()
    vehicles = Vehicles(world.assets, PUBLIC["owner"], (), clock)
    with (
        intruder(address) as evil,
        running(world, address, paced=True, verify=vehicles.verify, take=vehicles.take),
    ):
        for kind in SIGNED:
            evil.send(topic(evil, kind.TOPIC), b"\xffgarbage", retain=True)
        north = station("north", clock)
        with joined(world, address, north) as fleet:
            until(lambda: "north is in command" in vehicles.in_command)
            lines(fleet, 5)
            header = json.loads(evil.heard[topic(evil, "takeover")])
            older = {
                **header,
                "message": auth.sign_takeover(KEYS["eve"], "cleo", 3, PUBLIC["lost"]),
            }
            evil.send(topic(evil, "takeover"), json.dumps(older).encode(), retain=True)
            told: list[str] = []
            until(lambda: bool(told.extend(lines(fleet)) or told))
            assert "a signed takeover changes nothing" in told[0]
            assert north.refusal == ""
            taken = {**header, "message": TO_SOUTH}
            evil.send(topic(evil, "takeover"), json.dumps(taken).encode(), retain=True)
            until(lambda: "south is in command" in vehicles.in_command)
            told.clear()
            until(lambda: bool(told.extend(lines(fleet)) or told))
            assert told[-1].endswith("south is in command since epoch 2")
            assert north.newest["takeover"] == TO_SOUTH
        with joined(world, address, station("north", clock)):
            later = station("south", clock)
            with closing(MqttFleet(world, join(address), later)):
                assert later.refusal == "", "what is retained is known before anything is sent"


def until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + LIMIT_S
    while not done():
        assert time.monotonic() < end, "it did not come to that"
        time.sleep(0.01)
