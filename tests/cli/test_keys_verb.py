"""`pa-console keys`: made, listed, enrolled, revoked, rotated, and a station put in command."""

import json
import re
import stat
import time
from pathlib import Path

import pytest

from pa_console.fleets.authorization import Approval, Trust, UnsignedApproval
from pa_console.fleets.key_folder import KeyFolder
from pa_console.schema.events import event as ev
from pa_console.session.log.chain import read_log
from pa_console.signing import KEY_VARIABLE, PASSPHRASE_VARIABLE, SigningError
from tests.cli.inside import Call, Done


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return where keys will be; none are there yet."""
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "config" / "signing-key.pem"))
    return tmp_path / "config" / "site-keys"


@pytest.fixture
def made(call: Call) -> Done:
    """Make the keys of a site."""
    done = call("keys", "make", "ann", "--station", "north")
    assert (done.code, done.err) == (0, "")
    return done


def listed(call: Call) -> dict[str, tuple[str, str, bool]]:
    rows = call("keys", "list", "--json").json["keys"]
    return {row["name"] or "-": (row["role"], row["state"], row["here"]) for row in rows}


def test_a_new_site_has_an_owner_a_station_in_command_and_a_commander(
    call: Call, made: Done, folder: Path
) -> None:
    assert "north is in command since epoch 1" in made.said
    assert listed(call) == {
        "owner": ("", "in force", True),
        "north": ("", "in command", True),
        "ann": ("commander", "in force", True),
    }
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert {stat.S_IMODE(file.stat().st_mode) for file in folder.iterdir()} == {0o600}
    again = call("keys", "make")
    assert (again.code, "there are keys already" in again.err) == (2, True)


def test_without_keys_it_is_said_how_they_are_made(call: Call) -> None:
    for words in (("list",), ("revoke", "ann"), ("takeover", "north")):
        done = call("keys", *words)
        assert done.code == 2
        assert "no keys of a site; make them with pa-console keys make" in done.said


@pytest.mark.usefixtures("made")
def test_one_more_person_is_enrolled_and_gets_another_role(call: Call) -> None:
    assert call("keys", "make", "bob").code == 0
    assert listed(call)["bob"] == ("operator", "in force", True)
    key = next(r["key"] for r in call("keys", "list", "--json").json["keys"] if r["name"] == "bob")
    assert call("keys", "enrol", "person", "bob", key, "--role", "observer").code == 0
    assert listed(call)["bob"][0] == "observer"
    other = call("keys", "enrol", "person", "bob", "a" * 64)
    assert (other.code, "has another key" in other.err) == (2, True)
    assert "is not a public key" in call("keys", "enrol", "station", "south", "abc").said
    assert "give the public key" in call("keys", "enrol", "station", "south").said
    assert "not a name for a key" in call("keys", "make", "../bob").said


@pytest.mark.usefixtures("made")
def test_a_revoked_key_never_comes_back(call: Call) -> None:
    call("keys", "make", "bob", "--role", "commander")
    assert call("keys", "revoke", "ann").code == 0
    rows = listed(call)
    assert "ann" not in rows
    assert rows["-"] == ("", "revoked", False)
    assert rows["north"][1] == "in command", "bob has put it in command again"
    assert "no person or station 'ann'; known: bob, north" in call("keys", "revoke", "ann").said
    lost = call("keys", "revoke", "north")
    assert "no station" in lost.said or "not enrolled" in lost.said


@pytest.mark.usefixtures("made")
def test_a_rotated_station_stays_in_command_with_a_new_key(call: Call, folder: Path) -> None:
    before = KeyFolder().keys()
    assert call("keys", "rotate", "north").code == 0
    after = KeyFolder().keys()
    assert after.station.private_bytes_raw() != before.station.private_bytes_raw()
    trust = KeyFolder().trust()
    assert trust.in_command == "north is in command since epoch 2"
    fresh = Trust(before.owner)
    assert [fresh.take(message) for message in after.messages] == ["", "", ""]
    assert call("keys", "rotate", "ann").code == 0
    assert KeyFolder().trust().in_command == "north is in command since epoch 3"
    assert KeyFolder().keys().own.private_bytes_raw() != before.own.private_bytes_raw()


@pytest.mark.usefixtures("made")
def test_another_station_takes_over(call: Call) -> None:
    assert "known: north" in call("keys", "takeover", "south").said
    assert call("keys", "enrol", "station", "south", "b" * 64).code == 0
    assert "south is in command since epoch 2" in call("keys", "takeover", "south").said


def test_a_second_machine_joins_and_gets_what_the_owner_signs(
    call: Call, made: Done, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    owner, other = KeyFolder(), KeyFolder(tmp_path / "other")
    earlier_roster = owner.messages[0]
    person, station = other.join("bob", "south", owner.owner)
    with pytest.raises(SigningError, match="no station in the roster has a key here"):
        other.keys()
    with pytest.raises(SigningError, match="owner is not on this machine"):
        other.revoke("bob")
    assert call("keys", "enrol", "person", "bob", person).code == 0
    assert call("keys", "enrol", "station", "south", station).code == 0
    for message in owner.messages:
        assert other.take(message) == ""
    assert other.messages == owner.messages
    assert "not newer" in other.take(earlier_roster)
    assert (other.keys().person, other.trust().in_command[:5]) == ("bob", "north")
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "third" / "key.pem"))
    joining = ("--role", "commander", "--station", "west", "--join", owner.owner)
    told = call("keys", "make", "cleo", *joining).said
    assert re.search(r"pa-console keys enrol person cleo \w{64} --role commander", told)
    assert "pa-console keys enrol station west" in told


def test_a_passphrase_protects_the_keys_of_people_and_of_the_owner(
    call: Call, monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    monkeypatch.setenv(PASSPHRASE_VARIABLE, "correct horse")
    assert call("keys", "make", "ann", "--station", "north", "--passphrase").code == 0
    for name in ("owner.pem", "person-ann.pem"):
        assert b"ENCRYPTED" in (folder / name).read_bytes()
    assert call("keys", "make", "bob").code == 0
    monkeypatch.setenv(PASSPHRASE_VARIABLE, "wrong")
    wrong = call("keys", "make", "cleo")
    assert (wrong.code, "wrong passphrase" in wrong.err) == (2, True)
    monkeypatch.delenv(PASSPHRASE_VARIABLE)
    assert f"set {PASSPHRASE_VARIABLE}" in call("keys", "make", "cleo").said


def to_sign(path: Path, message: str = "") -> Path:
    """Write what a served session answers who is to sign, or another `message`."""
    trust = KeyFolder().trust()
    asked = Approval(
        "ann", trust.roster.stations["north"], "S", "M1.1", ("Ugv_T01 block EastGate",),
        "b" * 64, next(iter(trust.roster.rules)), acts=("override",),
    )  # fmt: skip
    unsigned = UnsignedApproval.of(asked, time.time())
    path.write_text(json.dumps({"to_sign": message or unsigned.text, "orders": ["nothing"]}))
    return path


@pytest.mark.usefixtures("made")
def test_a_person_signs_what_was_asked_for_on_a_machine_without_its_session(
    call: Call, tmp_path: Path
) -> None:
    file = to_sign(tmp_path / "asked.json")
    done = call("keys", "sign", str(file), "--yes")
    assert done.code == 0, done.said
    assert "ann approves, at the station north: Ugv_T01 block EastGate" in done.said
    assert "the judge's objection is overridden" in done.said
    approval, _ = KeyFolder().trust().approval("ann", done.json["signed"], time.time())
    assert (done.json["person"], approval["orders"]) == ("ann", ["Ugv_T01 block EastGate"])
    unasked = call("keys", "sign", str(file))
    assert (unasked.code, "or use --yes" in unasked.err, unasked.out) == (2, True, "")


@pytest.mark.usefixtures("made")
def test_nobody_is_made_to_sign_anything_but_an_approval(call: Call, tmp_path: Path) -> None:
    folder = KeyFolder()
    takeover = folder.messages[-1].rpartition(".")[0]
    for message, said in (
        (takeover, "a message of another kind than an approval"),
        ("nonsense", "two parts in base64url"),
    ):
        done = call("keys", "sign", str(to_sign(tmp_path / "other.json", message)), "--yes")
        assert (done.code, said in done.said, done.out) == (2, True, "")
    (tmp_path / "none.json").write_text("[]")
    done = call("keys", "sign", str(tmp_path / "none.json"), "--yes")
    assert (done.code, "give the answer of GET /v1/plans/ID/approval" in done.said) == (2, True)


@pytest.mark.usefixtures("made")
def test_a_key_that_others_may_read_is_not_used(call: Call, folder: Path) -> None:
    (folder / "owner.pem").chmod(0o644)
    done = call("keys", "make", "bob")
    assert (done.code, "others may read it" in done.said) == (2, True)
    (folder / "owner.pem").chmod(0o600)
    (folder / "roster.jwt").write_text("nonsense")
    broken = call("keys", "list")
    assert (broken.code, "roster.jwt: it is not valid" in broken.said) == (2, True)


@pytest.mark.usefixtures("made")
def test_rules_are_enrolled_with_what_they_ask_two_people_for(call: Call, tmp_path: Path) -> None:
    path = tmp_path / "house.yaml"
    path.write_text(
        "name: house\napprovals: {block: 2, override: 2}\nrules:\n"
        "  - {id: ROE-20, domain: ROE, priority: high, text: Be safe.}\n"
    )
    done = call("keys", "enrol", "rules", str(path))
    assert "required approvals: block 2, override 2" in done.said
    assert "block 2, override 2" in call("rules", "list", "--rules", str(path)).said
    assert "block 2, override 2" in call("rules", "check", str(path)).said


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("{blok: 2}", "'blok' is not an act that people approve; known: move_to, "),
        ("{hold: 2}", "'hold' moves no asset and never waits for a second person; remove it"),
        ("{block: 0}", "block: 0 people; give a number from 1 to 9"),
        ("{block: two}", "approvals"),
    ],
)
def test_what_cannot_be_asked_for_is_said_with_its_line(
    call: Call, tmp_path: Path, asked: str, said: str
) -> None:
    path = tmp_path / "house.yaml"
    path.write_text(
        f"name: house\napprovals: {asked}\nrules:\n"
        "  - {id: ROE-20, domain: ROE, priority: high, text: Be safe.}\n"
    )
    done = call("rules", "check", str(path))
    assert done.code == 2
    assert said in done.said
    assert f"{path}:2" in done.err.replace("\n", "")


@pytest.mark.usefixtures("made", "engine")
def test_a_mission_is_signed_by_whoever_has_the_keys(call: Call, tmp_path: Path) -> None:
    log = tmp_path / "one.jsonl"
    done = call(
        "--set", "standing_confidence=0", "mission", "Send Drone_T04 to EastGate.",
        "--approve", "auto", "--log", str(log),
    )  # fmt: skip
    assert done.code == 0, done.said
    made = [e.data for e in read_log(log) if isinstance(e.data, ev.DecisionMade)]
    assert set(made[0].decision.signatures) == {"ann"}
