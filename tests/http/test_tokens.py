"""Tokens: shown once, kept as hashes, for their owner alone, and no more than a roster gives."""

import stat
from pathlib import Path

import pytest

from pa_console.fleets.authorization import RefusedError, Role
from pa_console.http.bodies import ActionBody, plan_of
from pa_console.http.guard import RequestRate
from pa_console.http.served_session import KEPT, EventFeed
from pa_console.http.tokens import Bearer, TokenBook
from pa_console.private_files import NotPrivateError
from pa_console.schema.events import event as ev
from tests.session.logs import kept, write_log
from tests.session.story import at, telemetry


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "private" / "serve-tokens.json"


def test_a_token_is_found_again_and_cannot_be_told_from_the_file(file: Path) -> None:
    token = TokenBook(file).make("anna", "operator")
    assert TokenBook(file).find(token) == Bearer("anna", "operator")
    assert token not in file.read_text()
    assert token.removeprefix("pa_") not in file.read_text()
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert stat.S_IMODE(file.parent.stat().st_mode) == 0o700
    assert TokenBook(file).find(token[:-1]) is None
    assert TokenBook(file).find("") is None


def test_a_revoked_token_is_refused_from_the_next_request_on(file: Path) -> None:
    serving, other = TokenBook(file), TokenBook(file)
    token, kept = other.make("anna", "operator"), other.make("olaf", "observer")
    assert serving.find(token)
    (row,) = (row for row in other.listed() if row.person == "anna")
    other.revoke(row.id)
    assert serving.find(token) is None
    assert serving.find(kept)
    with pytest.raises(ValueError, match="there is no token"):
        other.revoke(row.id)


def test_a_token_of_a_session_is_in_no_file(file: Path) -> None:
    book = TokenBook(file)
    token = book.make("anna", "operator", keep=False)
    assert book.find(token)
    assert not file.exists()
    assert TokenBook(file).find(token) is None


def test_a_file_that_others_may_read_or_that_is_none_lets_nobody_in(file: Path) -> None:
    token = TokenBook(file).make("anna", "operator")
    file.chmod(0o644)
    with pytest.raises(NotPrivateError):
        TokenBook(file).find(token)
    file.chmod(0o600)
    file.write_text('[{"person": "eve", "role": "emperor"}]')
    with pytest.raises(ValueError, match="not a list of tokens"):
        TokenBook(file).find(token)


@pytest.mark.parametrize("name", ["", "standing instruction: auto", "a b", "é", "x" * 65, "../x"])
def test_nobody_has_a_name_that_could_mean_something_else(file: Path, name: str) -> None:
    with pytest.raises(ValueError, match="is not a name"):
        TokenBook(file).make(name, "operator")


def test_a_roster_takes_back_what_a_token_gave(file: Path) -> None:
    roster: dict[str, Role] = {"anna": "commander", "olaf": "operator"}

    def role_of(person: str) -> Role:
        if person not in roster:
            raise RefusedError(f"{person} is not in the roster")
        return roster[person]

    book = TokenBook(file, role_of)
    anna, olaf = book.make("anna", "operator"), book.make("olaf", "operator")
    with pytest.raises(ValueError, match="another role"):
        book.make("olaf", "commander")
    with pytest.raises(ValueError, match="not in the roster"):
        book.make("eve", "observer")
    roster["olaf"] = "observer"
    assert book.find(olaf) == Bearer("olaf", "observer")
    del roster["anna"]
    with pytest.raises(RefusedError):
        book.find(anna)


def test_a_bucket_lets_a_burst_through_and_fills_with_time() -> None:
    now = 0.0
    rate = RequestRate(2.0, 3, clock=lambda: now)
    assert [rate.take("a") for _ in range(4)] == [0, 0, 0, 1]
    assert rate.take("b") == 0
    now = 0.5
    assert [rate.take("a") for _ in range(2)] == [0, 1]


async def test_what_memory_has_not_any_more_is_read_from_the_log(tmp_path: Path) -> None:
    pictures = [telemetry(float(second)) for second in range(KEPT + 500)]
    happened = [*kept(), *pictures]
    log = write_log(tmp_path / "session.jsonl", happened)
    feed = EventFeed(lambda: log)
    for event in happened:
        feed.put(event)
    feed.put(at(0.0, ev.TextStreamed(role="planner", attempt=1, text="transient")))
    feed.end()
    for after in (0, 7, len(happened) - KEPT - 1, len(happened) - 3, len(happened) + 9):
        items = [item async for item in feed.follow(after) if item is not None]
        assert [item.event for item in items] == happened[after:]
        assert [item.number for item in items] == list(range(after + 1, len(happened) + 1))


def test_a_plan_of_the_operators_own_keeps_its_steps() -> None:
    bodies = (
        ActionBody(agent="Robot_T01", command="move_to NorthGate", stay_s=5.0),
        ActionBody(agent="Ugv_T02", command="return_to_base", after=[1]),
    )
    plan = plan_of(bodies, "")
    assert plan.steps == ((1,), (2,))
    assert plan.actions[0].stay_s == 5.0
