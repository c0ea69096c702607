"""A vehicle carries out what named people approved, once, and tells why it refuses the rest."""

import random
import sqlite3
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from pa_console.fleets import authorization as auth
from pa_console.fleets.authorization.messages import sign
from pa_console.schema.command import DeviceCommand
from tests.fleets.keyring import (
    KEYS,
    NOW,
    PLAN,
    PUBLIC,
    REVOCATION,
    ROSTER,
    RULES,
    SIGNED_ROSTER,
    TO_NORTH,
    TO_SOUTH,
    Clock,
    Vehicle,
    approval_of,
    order,
    token_of,
)

pytestmark = pytest.mark.invariant

MOVE, BLOCK = order(), order("block")
SAID = auth.words(MOVE)
ALONE = """
import sys
import pa_console.fleets.authorization
print(*(name for name in sys.modules if name.partition(".")[0] == "pa_console"))
print(*({name.partition(".")[0] for name in sys.modules} - set(sys.stdlib_module_names)))
"""


def test_what_was_approved_is_carried_out_and_once() -> None:
    vehicle = Vehicle()
    token = token_of(MOVE)
    assert vehicle.get(token, MOVE) == ""
    assert vehicle.get(token, MOVE) == "its authorization was used before"
    assert vehicle.get(token_of(MOVE, now=NOW + 1), MOVE) == "its authorization was used before"
    assert vehicle.carried_out == [MOVE]


def altered(token: str, at: int) -> str:
    return token[:at] + ("A" if token[at] != "A" else "B") + token[at + 1 :]


HONEST = token_of(MOVE)
REFUSED = {
    "no authorization": None,
    "cannot be read": "not a token",
    "wrong key": token_of(MOVE, key="eve"),
    "was altered": altered(HONEST, len(HONEST) // 2),
    "is for Ugv_T02, not for Ugv_T01": token_of(MOVE, serial="Ugv_T02"),
    "expired 68.0 s ago": token_of(MOVE, now=NOW - 98),
    "becomes valid only in 60.0 s": token_of(MOVE, now=NOW + 60),
    "for another command": token_of(BLOCK, ("ann", "bob")),
    "the rule set dddddddddddd is not enrolled": auth.sign_command(
        KEYS["north"],
        MOVE,
        auth.Grounds("ann", "S", PLAN, "d" * 64, "operator", 1, {}),
        NOW,
    ),
    "otto has the role observer": token_of(MOVE, ("otto",)),
    "'eve' is not in the roster": token_of(MOVE, ("eve",)),
    "the key of gone was revoked": token_of(MOVE, ("gone",)),
    "ann has not approved it": token_of(MOVE, approvals={}),
    "the approval of ann was altered, or signed with a wrong key": token_of(
        MOVE, approvals={"ann": approval_of("ann", SAID, key="bob")}
    ),
    "is not for Ugv_T01 move_to EastGate": token_of(
        MOVE, approvals={"ann": approval_of("ann", "Ugv_T01 move_to WestGate")}
    ),
    "was not given to this station": token_of(
        MOVE, approvals={"ann": approval_of("ann", SAID, station="south")}
    ),
    "another plan or another rule set": token_of(
        MOVE, approvals={"ann": approval_of("ann", SAID, plan="e" * 64)}
    ),
    "the approval of ann expired": token_of(
        MOVE, approvals={"ann": approval_of("ann", SAID, now=NOW - 3700)}
    ),
    "has not approved it as 'override'": token_of(
        MOVE, approvals={"ann": approval_of("ann", SAID)}, kind="override"
    ),
    "override needs 2 approvals, but it has 1": token_of(MOVE, kind="override", acts=("override",)),
    "this vehicle does not know epoch 2; north is in command since epoch 1": token_of(
        MOVE, epoch=2
    ),
    "south signed it in epoch 1; north is in command": token_of(MOVE, station="south"),
    "is a message of another kind": approval_of("ann", SAID, key="north"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_what_is_refused_is_told_why(why: str) -> None:
    vehicle = Vehicle()
    assert why in vehicle.get(REFUSED[why], MOVE)
    assert not vehicle.carried_out
    assert vehicle.get(HONEST, MOVE) == "", "and nothing is used up by that"


def test_the_same_token_written_otherwise_is_refused() -> None:
    last = HONEST[-1]
    others = {altered(HONEST, len(HONEST) - 1), HONEST[:-1] + chr(ord(last) + 1), HONEST + "="}
    for other in others - {HONEST}:
        vehicle = Vehicle()
        assert vehicle.get(other, MOVE)
        assert not vehicle.carried_out


def test_a_hold_never_needs_a_token() -> None:
    hold = order("hold", None)
    untold = Vehicle(told=())
    for token in (None, "", "garbage", HONEST):
        assert untold.get(token, hold) == ""
    assert "no station is in command" in untold.get(HONEST, MOVE)


def test_two_approvals_are_of_two_people() -> None:
    both = token_of(BLOCK, ("ann", "bob"))
    assert "block needs 2 approvals, but it has 1" in Vehicle().get(token_of(BLOCK), BLOCK)
    assert Vehicle().get(both, BLOCK) == ""
    twins = replace(ROSTER, serial=2, people={**ROSTER.people, "bob": ROSTER.people["ann"]})
    vehicle = Vehicle(told=(auth.sign_roster(KEYS["owner"], twins), TO_NORTH))
    said = auth.words(BLOCK)
    signed = {"ann": approval_of("ann", said), "bob": approval_of("bob", said, key="ann")}
    assert "it has 1" in vehicle.get(token_of(BLOCK, ("ann", "bob"), approvals=signed), BLOCK)


def test_what_one_of_two_people_overrides_is_overridden_by_one() -> None:
    signed = {
        "ann": approval_of("ann", SAID, kind="override", acts=("override",)),
        "bob": approval_of("bob", SAID),
    }
    token = token_of(MOVE, ("ann", "bob"), approvals=signed, kind="override")
    assert "override needs 2 approvals, but it has 1" in Vehicle().get(token, MOVE)
    signed["bob"] = approval_of("bob", SAID, kind="override", acts=("override",))
    token = token_of(MOVE, ("ann", "bob"), approvals=signed, kind="override")
    assert Vehicle().get(token, MOVE) == ""


def test_a_new_vehicle_may_ask_for_two_people_at_first() -> None:
    rules = {RULES: auth.EnrolledRules("checkpoint", {"first_order": 2})}
    signed = auth.sign_roster(KEYS["owner"], replace(ROSTER, serial=2, rules=rules))
    vehicle = Vehicle(told=(signed, TO_NORTH))
    assert "first_order needs 2 approvals" in vehicle.get(token_of(MOVE), MOVE)
    assert vehicle.get(token_of(MOVE, ("ann", "bob")), MOVE) == ""
    again = order(number=2)
    later = token_of(again, approvals={"ann": approval_of("ann", SAID, request="M1.2")})
    assert vehicle.get(later, again) == ""


def test_a_stolen_station_key_repeats_nothing_that_was_approved_once() -> None:
    vehicle, signed = Vehicle(), {"ann": approval_of("ann", SAID)}
    assert vehicle.get(token_of(MOVE, approvals=signed), MOVE) == ""
    again = order(number=2)
    why = vehicle.get(token_of(again, approvals=signed), again)
    assert why == "the order that ann approved was used before"
    twice = {"ann": approval_of("ann", SAID, SAID, request="M1.2")}
    for number in (3, 4):
        command = order(number=number)
        assert vehicle.get(token_of(command, approvals=twice), command) == ""
    third = order(number=5)
    assert vehicle.get(token_of(third, approvals=twice), third)


def test_trust_grows_and_never_shrinks() -> None:
    verifier = Vehicle().verifier
    owner, newer = KEYS["owner"], replace(ROSTER, serial=3)
    assert verifier.take(auth.sign_roster(owner, newer)) == ""
    assert "roster 1 is not newer than 3" in verifier.take(SIGNED_ROSTER)
    other = replace(newer, stations={})
    assert "not newer" in verifier.take(auth.sign_roster(owner, other)), "another of that serial"
    assert "wrong key" in verifier.take(auth.sign_roster(KEYS["cleo"], replace(newer, serial=4)))
    assert "not newer" in verifier.take(auth.sign_revocation(owner, 0, []))
    assert "stays revoked" in verifier.take(auth.sign_revocation(owner, 2, [PUBLIC["eve"]]))
    assert verifier.take(REVOCATION) == "", "the same again changes nothing"
    assert "wrong key" in verifier.take(auth.sign_revocation(KEYS["north"], 9, [PUBLIC["ann"]]))
    assert "changes no trust" in verifier.take(HONEST)
    assert verifier.take("garbage")


@pytest.mark.parametrize(
    ("person", "key", "epoch", "station", "why"),
    [
        ("ann", "ann", 2, "south", "only commanders give command"),
        ("cleo", "ann", 2, "south", "wrong key"),
        ("eve", "eve", 2, "south", "not in the roster"),
        ("cleo", "cleo", 0, "south", "not newer"),
        ("cleo", "cleo", -1, "south", "not a whole number"),
    ],
)
def test_only_a_commander_gives_command_and_only_onwards(
    person: str, key: str, epoch: int, station: str, why: str
) -> None:
    vehicle = Vehicle()
    message = auth.sign_takeover(KEYS[key], person, epoch, PUBLIC[station])
    assert why in vehicle.verifier.take(message)
    assert vehicle.get(HONEST, MOVE) == "", "the station before is still in command"


def test_of_two_takeovers_of_one_epoch_everybody_who_has_heard_both_goes_by_the_same() -> None:
    both = [auth.sign_takeover(KEYS["cleo"], "cleo", 2, PUBLIC[to]) for to in ("north", "south")]
    for way in (both, both[::-1]):
        vehicle = Vehicle()
        told = [vehicle.verifier.take(message) for message in way]
        last = max(PUBLIC["north"], PUBLIC["south"])
        assert vehicle.verifier.trust.takeover.station == last
        assert [bool(why) for why in told].count(True) == (way[0] == both[1])


@pytest.mark.parametrize("station", ["eve", "lost"])
def test_a_station_that_is_not_enrolled_can_be_put_in_command_and_commands_nothing(
    station: str,
) -> None:
    vehicle = Vehicle()
    message = auth.sign_takeover(KEYS["cleo"], "cleo", 2, PUBLIC[station])
    assert vehicle.verifier.take(message) == ""
    token = token_of(MOVE, station=station, epoch=2)
    assert vehicle.get(token, MOVE)
    assert vehicle.get(HONEST, MOVE), "nor does the one before"


def test_a_vehicle_that_has_forgotten_everything_takes_no_takeover_of_before_the_roster() -> None:
    newer = auth.sign_roster(KEYS["owner"], replace(ROSTER, serial=2, epoch=2))
    vehicle = Vehicle(told=(newer,))
    assert "epoch 1 is over" in vehicle.verifier.take(TO_NORTH)
    assert vehicle.verifier.take(TO_SOUTH) == ""


@pytest.mark.parametrize("seed", range(100))
def test_nothing_of_the_old_station_is_carried_out_after_a_takeover(seed: int) -> None:
    chance = random.Random(seed)
    vehicle = Vehicle(told=(SIGNED_ROSTER, TO_NORTH))
    moment, at_takeover = chance.randrange(40), -1
    late: list[tuple[str, DeviceCommand]] = []
    for number in range(40):
        if number == moment:
            assert vehicle.verifier.take(TO_SOUTH) == ""
            at_takeover = len(vehicle.carried_out)
        vehicle.clock.at += chance.random()
        command = order(number=number)
        signed = {"ann": approval_of("ann", SAID, request=f"M{number}", now=vehicle.clock.at)}
        old = token_of(command, approvals=signed, now=vehicle.clock.at)
        if chance.random() < 0.3:
            late.append((old, command))  # it is held up on its way
            continue
        assert (vehicle.get(old, command) == "") == (number < moment)
        if late and chance.random() < 0.5:
            vehicle.get(*late.pop(chance.randrange(len(late))))
    for old, command in late:
        assert vehicle.get(old, command)
    assert at_takeover >= 0
    assert len(vehicle.carried_out) == at_takeover
    command = order(number=99)
    signed = {"ann": approval_of("ann", SAID, station="south", now=vehicle.clock.at)}
    new = token_of(command, station="south", epoch=2, approvals=signed, now=vehicle.clock.at)
    assert vehicle.get(new, command) == ""
    assert "not newer" in vehicle.verifier.take(TO_NORTH)


def test_a_restart_forgets_nothing(tmp_path: Path) -> None:
    file = tmp_path / "memory"
    before = Vehicle(memory=auth.Memory(file), told=(SIGNED_ROSTER, REVOCATION, TO_NORTH))
    assert before.get(HONEST, MOVE) == ""
    assert before.verifier.take(TO_SOUTH) == ""
    before.memory.close()
    assert file.stat().st_mode & 0o777 == 0o600
    after = Vehicle(memory=auth.Memory(file), told=())
    assert "in command since epoch 2" in after.get(HONEST, MOVE)
    assert "not newer" in after.verifier.take(TO_NORTH)
    assert "revoked" in after.get(token_of(MOVE, ("gone",), station="south", epoch=2), MOVE)
    after.memory.close()
    with pytest.raises(ValueError, match="belongs to a vehicle of the owner"):
        auth.Verifier("Ugv_T01", PUBLIC["eve"], auth.Memory(file))


def test_a_token_used_before_a_restart_stays_used(tmp_path: Path) -> None:
    file = tmp_path / "memory"
    before = Vehicle(memory=auth.Memory(file))
    assert before.get(HONEST, MOVE) == ""
    before.memory.close()
    assert "used before" in Vehicle(memory=auth.Memory(file), told=()).get(HONEST, MOVE)


def test_a_memory_that_cannot_be_written_carries_out_nothing() -> None:
    vehicle = Vehicle()
    vehicle.memory.close()
    assert "cannot be checked" in vehicle.get(HONEST, MOVE)
    assert vehicle.get(None, order("hold", None)) == ""


def test_the_memory_is_bounded_and_what_it_forgot_is_not_taken_again(tmp_path: Path) -> None:
    clock, file = Clock(), tmp_path / "memory"
    vehicle = Vehicle(clock=clock, memory=auth.Memory(file, most=10))
    sent: list[tuple[str, DeviceCommand]] = []
    for number in range(50):
        clock.at += 0.5
        command = order(number=number)
        signed = {"ann": approval_of("ann", SAID, request=f"M{number}", now=clock.at)}
        sent.append((token_of(command, approvals=signed, now=clock.at), command))
        assert vehicle.get(*sent[-1]) == ""
    with sqlite3.connect(file) as base:
        assert base.execute("SELECT count(*) FROM used").fetchone()[0] <= 20
    clock.at = NOW + 1.0  # a clock that was set back
    assert all(vehicle.get(*again) for again in sent)
    vehicle.memory.close()
    after = Vehicle(clock=clock, memory=auth.Memory(file, most=10), told=())
    assert all(after.get(*again) for again in sent)


@pytest.mark.parametrize("limit", [float("nan"), float("inf"), 1e300, "soon", None, True])
def test_a_time_that_is_none_is_refused(limit: object) -> None:
    for name in ("nbf", "exp"):
        claims = {"iss": PUBLIC["north"], "epoch": 1, "aud": "Ugv_T01", "jti": MOVE.command_id}
        claims |= {"command": auth.digest(MOVE), "nbf": NOW, "exp": NOW + 1, name: limit}
        token = sign("command", claims, KEYS["north"])
        assert Vehicle().get(token, MOVE)


def test_a_vehicle_needs_no_other_part_of_the_console() -> None:
    run = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, check=True)
    ours, others = (set(line.split()) for line in run.stdout.splitlines())
    parts = ("messages", "trust", "verifier")
    own = {f"pa_console.fleets.authorization.{part}" for part in parts}
    assert ours == {"pa_console", "pa_console.fleets", "pa_console.fleets.authorization"} | own
    public = {name for name in others if not name.startswith("_")}
    assert public == {"pa_console", "jwt", "cryptography"}
