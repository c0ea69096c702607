"""What a TAK server has told is folded: bounded, told once, gone when the session goes on."""

from collections.abc import Iterable

from pa_console.schema.events import event as ev
from pa_console.session.recording import Player
from pa_console.session.state import SessionState
from tests.tui import story

UNIT, HOSTILE = story.reported()
LEFT_OUT = ev.ContactsLeftOut(outside=3, unreadable=1)


def folded(payloads: Iterable[ev.EventPayload]) -> SessionState:
    state = SessionState()
    for event in story.stamped(list(payloads)):
        state.apply(event)
    return state


def lines(state: SessionState) -> list[str]:
    return [f"{notice.level}: {notice.text}" for notice in state.notices]


def test_a_contact_that_moves_has_one_line_and_its_last_place() -> None:
    assert isinstance(UNIT, ev.ContactReported)
    moved = UNIT.contact.model_copy(update={"at": (1.0, 2.0)})
    state = folded([UNIT, ev.ContactReported(contact=moved)])
    assert state.reported_contacts == {"ANDROID-1": moved}
    assert lines(state) == [
        "info: reported, not seen by our sensors: "
        "“ALPHA 1”, said to be friend, ground unit, at (-24, 24)"
    ]


def test_no_log_fills_the_screen_with_contacts() -> None:
    assert isinstance(UNIT, ev.ContactReported)
    contact = UNIT.contact
    many = [
        ev.ContactReported(contact=contact.model_copy(update={"uid": f"U{n}"})) for n in range(500)
    ]
    assert len(folded(many).reported_contacts) == ev.MOST_CONTACTS


def test_a_connection_is_told_of_when_it_goes_and_comes_and_not_at_each_try() -> None:
    down = [
        story.TAK_UP.model_copy(update={"state": "away", "detail": f"no connection: {why}"})
        for why in ("closed", "refused", "no answer")
    ]
    state = folded([story.TAK_UP, *down])
    assert lines(state) == [
        "info: connected to tls://tak.example:8089", "warning: no connection: closed",
    ]  # fmt: skip
    assert state.tak.connection is not None
    assert (state.tak.away, state.tak.connection.detail) == (True, "no connection: no answer")
    assert state.tak.since == list(story.stamped([story.TAK_UP, *down]))[1].t


def test_what_is_left_out_is_told_once_of_each_reason() -> None:
    more = ev.ContactsLeftOut(outside=9, too_many=1, unreadable=2)
    state = folded([LEFT_OUT, more, more])
    assert len(lines(state)) == 3
    assert state.tak.left_out == more


def test_a_session_that_goes_on_knows_no_contact_of_before() -> None:
    resumed = ev.SessionResumed(version="0.2.0")
    state = folded([story.TAK_UP, UNIT, HOSTILE, resumed])
    assert not state.reported_contacts
    assert state.tak.connection is None


def test_every_place_of_a_replay_has_the_contacts_of_that_moment() -> None:
    told = [
        *story.opening(), story.TAK_UP, UNIT, LEFT_OUT, HOSTILE,
        ev.ContactLost(uid="ANDROID-1", reason="stale"), ev.SessionEnded(reason="over"),
    ]  # fmt: skip
    player = Player.of(story.stamped(told))
    for number in (8, 5, 9, 6, 7):
        player.to_event(number)
        assert player.state.tak == folded(told[: number + 1]).tak
