"""Ten thousand hostile commands published straight to vehicles: not one is carried out.

Whoever sends them has read everything that was ever sent, can change any of it, holds keys of his
own, those of an observer, of people and stations that were revoked or are not in command, and even
the key of the station in command, but of nobody who may approve.
"""

import json
from dataclasses import asdict, replace

import jwt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets import authorization as auth
from pa_console.schema.command import COMMANDS, DeviceCommand
from tests.fleets.keyring import (
    KEYS,
    NOW,
    PLAN,
    PUBLIC,
    REVOCATION,
    RULES,
    SIGNED_ROSTER,
    TO_NORTH,
    TO_SOUTH,
    Vehicle,
    approval_of,
    order,
    token_of,
)

pytestmark = pytest.mark.long

EACH = 20
EXAMPLES = 500
"""EXAMPLES times EACH commands are drawn."""

VEHICLES = ("Ugv_T01", "Ugv_T02")
STOLEN = ("eve", "otto", "gone", "lost", "south", "north")
MOVING = tuple(verb for verb in COMMANDS if verb not in auth.UNSIGNED)
FRESH = order("move_to", "EastGate", 1)
"""A command that is approved, sent, and has not reached its vehicle yet."""

USED = (order("move_to", "WestGate", 2), order("return_to_base", None, 3), order("block", "X", 4))
TOKENS = {
    FRESH.command_id: token_of(FRESH),
    **{command.command_id: token_of(command, ("ann", "bob")) for command in USED},
    "other": token_of(order(agent="Ugv_T02", number=9)),
}
HEARD = (*TOKENS.values(), SIGNED_ROSTER, REVOCATION, TO_NORTH, TO_SOUTH)

commands = st.builds(
    DeviceCommand,
    command_id=st.sampled_from(("M1.1.1", "M1.1.2", "M1.1.3", "M1.1.4", "M1.1.9", "M2.1.1", "")),
    agent=st.sampled_from((*VEHICLES, "Drone_T01")),
    verb=st.sampled_from(MOVING),
    target=st.sampled_from((None, "EastGate", "WestGate", "X")),
)
times = st.one_of(
    st.floats(NOW - 1e6, NOW - 40), st.floats(NOW + 40, NOW + 1e6), st.sampled_from((0.0, -1.0))
)
Attack = tuple[str | None, DeviceCommand, float]
"""What is sent, and when."""


def forged(key: str, command: DeviceCommand, approver: str, signer: str, epoch: int) -> Attack:
    """A token that claims an approval which its signer could not give."""
    said = auth.words(command)
    signed = {approver: approval_of(approver, said, key=signer)}
    token = token_of(command, (approver,), key=key, station="north", epoch=epoch, approvals=signed)
    return token, command, NOW


def misused(command: DeviceCommand, station: str, plan: str) -> Attack:
    """A token for a command, with somebody's approval of another one."""
    signed = {"ann": approval_of("ann", "Ugv_T01 report", station=station, plan=plan)}
    return token_of(command, key="north", approvals=signed), command, NOW


def claimed(token: str, key: str, name: str, value: object) -> str:
    """`token` with another claim, signed anew with a key that was stolen."""
    claims = jwt.decode(token, options={"verify_signature": False})
    payload = json.dumps({**claims, name: value}).encode()
    return jwt.PyJWS().encode(payload, KEYS[key], "EdDSA", headers={"typ": "pa-command+jwt"})


def altered(token: str, at: int, to: str) -> str:
    at %= len(token)
    return token[:at] + to + token[at + 1 :]


def spliced(one: str, other: str, cut: int) -> str:
    parts, others = one.split("."), other.split(".")
    return ".".join([*parts[: cut % 3], *others[cut % 3 :]])


heard = st.sampled_from(HEARD)
attacks: st.SearchStrategy[Attack] = st.one_of(
    # no authorization, or nothing that is one
    st.tuples(st.one_of(st.none(), st.just(""), st.text(max_size=60)), commands, st.just(NOW)),
    # forged: with every key that could be stolen, in the name of whoever may approve, or not
    st.builds(
        forged,
        st.sampled_from(STOLEN),
        commands,
        st.sampled_from(("ann", "bob", "cleo", "otto", "gone", "eve")),
        st.sampled_from(("eve", "otto", "gone", "north", "south", "lost", "owner")),
        st.integers(0, 5),
    ),
    # replayed: whatever was heard, for whatever command, at whatever time
    st.tuples(heard, st.one_of(commands, st.sampled_from(USED)), st.one_of(st.just(NOW), times)),
    # too early and too late
    st.tuples(st.just(TOKENS[FRESH.command_id]), st.just(FRESH), times),
    # altered in one character, or put together from two
    st.tuples(
        st.builds(altered, heard, st.integers(0, 5000), st.sampled_from("Aa0_-.=+/é\n")),
        st.just(FRESH),
        st.just(NOW),
    ),
    st.tuples(st.builds(spliced, heard, heard, st.integers(0, 2)), commands, st.just(NOW)),
    # another claim, with a stolen station's key: the approval inside does not fit any more
    st.tuples(
        st.builds(
            claimed,
            st.just(TOKENS["M1.1.2"]),
            st.sampled_from(STOLEN),
            st.sampled_from(("jti", "aud", "exp", "epoch", "rules", "plan", "sub", "session")),
            st.sampled_from(("M9", "Ugv_T01", NOW + 1e9, 7, "d" * 64, "otto", None, [], {})),
        ),
        commands,
        st.just(NOW),
    ),
    # approved by people who may, for other orders, another station or another plan
    st.builds(
        misused,
        commands.filter(lambda command: auth.words(command) != "Ugv_T01 report"),
        st.sampled_from(("north", "south", "lost")),
        st.sampled_from((PLAN, "e" * 64)),
    ),
)
is_honest = {(TOKENS[FRESH.command_id], FRESH)}


@settings(max_examples=EXAMPLES, deadline=None)
@given(st.lists(attacks, min_size=EACH, max_size=EACH), st.sampled_from(VEHICLES))
def test_no_hostile_command_is_carried_out(sent: list[Attack], serial: str) -> None:
    vehicle = Vehicle(serial)
    if serial == "Ugv_T01":
        for command in USED:
            assert vehicle.get(TOKENS[command.command_id], command) == ""
    done = list(vehicle.carried_out)
    for token, command, at in sent:
        if (token, command) in is_honest and at == NOW:
            continue
        vehicle.clock.at = at
        assert vehicle.get(token, command)
    assert vehicle.carried_out == done
    vehicle.clock.at = NOW
    if serial == "Ugv_T01":
        assert vehicle.get(TOKENS[FRESH.command_id], FRESH) == "", "what was approved still passes"


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(tuple(KEYS)),
    st.sampled_from(("ann", "bob", "cleo", "otto", "gone", "eve")),
    st.integers(-2, 5),
    st.sampled_from(("north", "south", "lost", "eve")),
    st.integers(0, 9),
)
def test_no_stolen_key_changes_what_a_vehicle_goes_by(
    key: str, person: str, epoch: int, station: str, serial: int
) -> None:
    verifier = Vehicle().verifier
    before = asdict(verifier.trust.roster), verifier.trust.revoked, verifier.trust.takeover
    mine = replace(
        verifier.trust.roster,
        serial=serial,
        people={"eve": auth.Person(PUBLIC["eve"], "commander")},
    )
    if key != "owner":
        assert verifier.take(auth.sign_roster(KEYS[key], mine))
        assert verifier.take(auth.sign_revocation(KEYS[key], serial, list(PUBLIC.values())))
    if (key, person) != ("cleo", "cleo"):
        assert verifier.take(auth.sign_takeover(KEYS[key], person, epoch, PUBLIC[station]))
    assert before == (
        asdict(verifier.trust.roster), verifier.trust.revoked, verifier.trust.takeover,
    )  # fmt: skip
    assert verifier.verify(auth.sign_command(KEYS["north"], FRESH, UNAPPROVED, NOW), FRESH)


UNAPPROVED = auth.Grounds("ann", "S", PLAN, RULES, "operator", 1, {})
