"""A console that was killed is started again: it asks, goes on in the same log, moves nothing."""

import signal

import pytest

from tests.cli.inside import Call
from tests.cli.outside import WITHIN_S, Start
from tests.cli.test_session_ends import ORDER, QUICK, set_moving

pytestmark = pytest.mark.long


def test_a_killed_console_goes_on_where_it_was(start: Start, call: Call) -> None:
    killed = start(*QUICK, "console", "--no-alarms", terminal=True)
    set_moving(killed)
    killed.process.kill()
    killed.process.wait(WITHIN_S)
    sent = killed.kinds.count("command_sent")

    again = start(*QUICK, "console", "--no-alarms", terminal=True)
    again.until_shown("Resume it?")
    assert ORDER in again.shown
    again.type("y\r")
    again.until("session_resumed")
    again.until("mission_finished")
    again.process.send_signal(signal.SIGTERM)
    assert again.process.wait(WITHIN_S) == 143
    assert again.kinds.count("command_sent") == sent
    finished = [r["data"] for r in again.records if r["kind"] == "mission_finished"]
    assert [data["status"] for data in finished] == ["held"]
    assert call("replay", str(again.log), "--verify").code == 0


def test_without_a_yes_a_new_session_begins_and_the_old_log_stays_as_it_is(
    start: Start,
) -> None:
    killed = start("console", "--no-alarms", terminal=True)
    killed.until("telemetry")
    killed.process.kill()
    killed.process.wait(WITHIN_S)
    log, was = killed.log, killed.log.read_bytes()

    again = start("console", "--no-alarms", terminal=True)
    again.until_shown("Resume it?")
    again.type("n\r")
    again.until_new(log)
    assert log.read_bytes() == was
    again.process.send_signal(signal.SIGTERM)
    assert again.process.wait(WITHIN_S) == 143
