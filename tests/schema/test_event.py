"""Every kind of event survives the way to JSON and back, and nothing else is read."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from pa_console.schema.events.event import Event, Payload
from tests.schema.strategies import PAYLOADS, events, models
from tests.session.story import START


@pytest.mark.parametrize("payload", PAYLOADS, ids=lambda model: model.__name__)
def test_every_payload_comes_back_as_it_went_out(payload: type[BaseModel]) -> None:
    @given(models(payload))
    @settings(max_examples=10, deadline=None)
    def check(data: BaseModel) -> None:
        event = Event.model_validate({"t": START, "tick": 1, "data": data})
        back = Event.model_validate_json(event.model_dump_json())
        assert back == event
        assert type(back.data) is payload

    check()


def test_every_payload_has_a_kind_of_its_own() -> None:
    kinds = [payload.model_fields["kind"].default for payload in PAYLOADS]
    assert len(set(kinds)) == len(kinds)
    assert set(PAYLOADS) == set(Payload.__subclasses__())


@given(events(), st.sampled_from(["t", "tick", "data"]))
@settings(max_examples=30, deadline=None)
def test_an_event_with_a_field_missing_or_unknown_is_refused(event: Event, field: str) -> None:
    fields = event.model_dump()
    with pytest.raises(ValidationError):
        Event.model_validate({**fields, "more": 1})
    del fields[field]
    with pytest.raises(ValidationError):
        Event.model_validate(fields)


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(ValidationError, match="explosion"):
        Event.model_validate({"t": START, "tick": 1, "data": {"kind": "explosion"}})


@given(events())
@settings(max_examples=20, deadline=None)
def test_an_event_cannot_be_changed(event: Event) -> None:
    with pytest.raises(ValidationError, match="frozen"):
        event.tick = 5
