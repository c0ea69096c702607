"""`pa-console site` and `--fleet`: what they make, and what they say when something is missing."""

from pathlib import Path

from pa_console.fleets.vda5050.broker import NUMBERS
from tests.cli.inside import Call
from tests.fleets.broker import free_port


def test_init_says_how_to_go_on_and_refuses_names_that_are_taken(
    call: Call, tmp_path: Path
) -> None:
    folder = tmp_path / "site"
    done = call("site", "init", str(folder), "--robot", "Robot_T03")
    assert done.code == 0
    assert "mosquitto -c" in done.said
    assert (folder / "Robot_T03.key").is_file()
    for name in ("site", "station", "no name", "../x"):
        refused = call("site", "init", str(folder), "--robot", name)
        assert (refused.code, refused.out) == (2, "")
        assert "--robot" in refused.err
    for option in ("--station", "--joined"):
        for name in ("2", "no name", "../x", "x" * 41):
            refused = call("site", "init", str(folder), option, name)
            assert (refused.code, refused.out) == (2, "")
            assert option in refused.err


def test_another_machine_has_a_folder_of_its_own_and_keeps_its_rights(
    call: Call, tmp_path: Path
) -> None:
    folder = tmp_path / "site"
    assert call("site", "init", str(folder), "--station", "south", "--joined", "bob").code == 0
    south = {f"{role}{end}" for role in ("station", "telemetry", "joined") for end in NUMBERS}
    assert {path.stem for path in (folder / "south").glob("*.key")} == south
    assert {path.stem for path in (folder / "bob").glob("*.key")} == {
        f"joined{end}" for end in NUMBERS
    }
    for name in ("south", "bob"):
        assert (folder / name / "ca.crt").read_bytes() == (folder / "ca.crt").read_bytes()
        assert not (folder / name / "ca.key").exists()
    users = {"station-south-2", "telemetry-south", "joined-south", "joined-bob-2"}
    for _ in range(2):
        lines = (folder / "access.txt").read_text().splitlines()
        assert {f"user {user}" for user in users} <= set(lines)
        assert "user station-bob" not in lines
        assert call("site", "init", str(folder)).code == 0


def test_without_certificates_or_a_broker_the_error_says_what_to_do(call: Call) -> None:
    closed = free_port()
    for words, says in (
        (("--fleet", "mqtts://localhost"), "--certificates"),
        (("--fleet", f"mqtt://127.0.0.1:{closed}"), "cannot connect to the broker"),
        (("--fleet", "nonsense"), "mqtts://HOST"),
        (("--fleet", "mqtt://127.0.0.1", "--scenario", "situation-2"), "site --scenario"),
    ):
        refused = call("mission", "hold", *words)
        assert (refused.code, refused.out) == (2, "")
        assert says in refused.err
