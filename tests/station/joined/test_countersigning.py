"""No message from a bus lets a plan through that two people of the roster have not signed."""

import asyncio
from collections import deque
from dataclasses import replace
from datetime import UTC, datetime
from types import SimpleNamespace
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets import authorization as auth
from pa_console.fleets.fleet import PlanCountersignature
from pa_console.fleets.station_authority import approval_of
from pa_console.fleets.vda5050.additions import Countersignature
from pa_console.fleets.vda5050.wire import Identity, Numbers, UnreadableError
from pa_console.mission.context import Stopwatch
from pa_console.mission.decide import answered, countersignature
from pa_console.mission.rehearse import device_commands
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from tests.fleets.keyring import KEYS, PUBLIC, RULES, TO_SOUTH
from tests.mission.gate import send
from tests.mission.test_two_people import BOOK, Site, decision_on, request

SENT = datetime(2026, 1, 1, tzinfo=UTC)
GOOD = ("bob", "cleo")
SIGNERS = ("ann", *GOOD, "otto", "gone", "eve")
WAYS = ("true", "true", "true", "plan", "session", "request", "station", "rules", "late", "bits")
HERE = ("approve here", "answer here")
ACTS = st.one_of(
    st.sampled_from(HERE),
    st.tuples(st.sampled_from(SIGNERS), st.sampled_from(SIGNERS), st.sampled_from(WAYS)),
)
Act = str | tuple[str, str, str]


class NoMoreError(Exception):
    """Nothing more happens."""


def message(site: Site, asked: ev.ApprovalRequested, act: tuple[str, str, str]) -> bytes:
    """What comes over the bus: the key of one person, the name of another, and what is wrong."""
    key, person, way = act
    approval = approval_of(
        request(1, "move") if way == "plan" else asked,
        person=person,
        station=PUBLIC["south" if way == "station" else "north"],
        session="other" if way == "session" else "S",
        rules="f" * 64 if way == "rules" else RULES,
    )
    if way == "request":
        approval = replace(approval, request="M9.1")
    at = site.clock.at - (auth.APPROVAL_S * 2 if way == "late" else 0.0)
    signature = auth.sign_approval(KEYS[key], approval, at)
    if way == "bits":
        signature = signature[:-4] + "AAAA"
    header = Numbers().header(Identity("pa-console", "north"), "countersignature", SENT)
    sent = Countersignature(
        **header, session="S", request_id=asked.request_id, person=person, approval=signature
    )
    return sent.write()


def from_bus(site: Site, payload: bytes) -> Decision | None:
    """What the station makes of a message, None where it is told and dropped."""
    try:
        got = Countersignature.read(payload)
    except UnreadableError:
        return None
    if site.authority.objection_to(got.request_id, got.person, got.approval):
        return None
    return countersignature(PlanCountersignature(got.request_id, got.person, got.approval))


def decided(site: Site, asked: ev.ApprovalRequested, decisions: list[Decision]) -> Decision | None:
    """What a request comes to that is answered so, None where it still waits at the end."""
    left, told = deque(decisions), list[Any]()

    async def decide() -> Decision:
        if not left:
            raise NoMoreError
        return left.popleft()

    services = SimpleNamespace(gate=site.gate, rulebook=BOOK)
    context = SimpleNamespace(
        services=services,
        mission=SimpleNamespace(standing=None, agent=""),
        emit=told.append,
        stopwatch=Stopwatch(),
    )
    try:
        return asyncio.run(answered(context, asked, decide)).decision  # pyright: ignore[reportArgumentType]
    except NoMoreError:
        return None


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(("block", "override", "acknowledge", "move")), st.lists(ACTS, max_size=8))
def test_no_history_of_messages_approves_what_two_people_have_not_signed(
    kind: str, acts: list[Act]
) -> None:
    site, asked = Site(), request(1, kind)
    decisions: list[Decision] = []
    for act in acts:
        if act == "approve here":
            decisions.append(decision_on(asked))
        elif act == "answer here":
            decisions.append(Decision(kind="choose", asked="nothing that was offered"))
        elif (got := from_bus(site, message(site, asked, act))) is not None:  # pyright: ignore[reportArgumentType]
            decisions.append(got)
    here = "approve here" in acts
    signed = {act[0] for act in acts if act[0] == act[1] in GOOD and act[2] == "true"}
    decision = decided(site, asked, decisions)
    if kind == "move":
        assert (decision is not None) == here, "one person is enough, and that is who sits here"
        return
    assert (decision is not None) == (here and bool(signed))
    if decision is not None:
        assert decision.signatures.keys() >= {"ann"}
        assert decision.signatures.keys() - {"ann"} <= signed
        site.gate.grant(asked, decision, BOOK)
        sent = send(site.gate, device_commands(asked.plan, asked.request_id)[0])
        assert isinstance(sent, ev.CommandSent), "the vehicle has checked both"


def test_what_was_signed_for_one_plan_is_none_for_the_next() -> None:
    site, first, second = Site(), request(1, "block"), request(2, "block")
    stale = from_bus(site, message(site, first, ("bob", "bob", "true")))
    assert stale is not None
    assert decided(site, second, [stale, decision_on(second)]) is None


def test_a_relieved_station_approves_nothing_more() -> None:
    site, asked = Site(), request(1, "block")
    bob = from_bus(site, message(site, asked, ("bob", "bob", "true")))
    assert bob is not None
    assert site.authority.take(TO_SOUTH) == ""
    assert decided(site, asked, [bob, decision_on(asked)]) is None
