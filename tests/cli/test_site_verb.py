"""`pa-console site` and `--fleet`: what they make, and what they say when something is missing."""

from pathlib import Path

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


def test_without_certificates_or_a_broker_the_error_says_what_to_do(call: Call) -> None:
    closed = free_port()
    for words, says in (
        (("--fleet", "mqtts://localhost"), "--certificates"),
        (("--fleet", f"mqtt://127.0.0.1:{closed}"), "no broker lets us in"),
        (("--fleet", "nonsense"), "mqtts://HOST"),
        (("--fleet", "mqtt://127.0.0.1", "--scenario", "situation-2"), "site --scenario"),
    ):
        refused = call("mission", "hold", *words)
        assert (refused.code, refused.out) == (2, "")
        assert says in refused.err
