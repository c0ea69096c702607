"""Over HTTP, too, nothing that takes two people is sent before two of them have signed it."""

import asyncio
import json
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import httpx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets import authorization as auth
from pa_console.fleets.fleet import PlanCountersignature
from pa_console.fleets.station_authority import approval_of
from pa_console.http.bodies import DecisionBody, SignatureBody
from pa_console.http.guard import ProblemError
from pa_console.http.http_app import make_app
from pa_console.http.served_session import ServedSession
from pa_console.http.tokens import Bearer, TokenBook
from pa_console.mission.context import Stopwatch
from pa_console.mission.decide import answered, countersignature
from pa_console.mission.rehearse import device_commands
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision, Mission
from pa_console.session.state import SessionState
from pa_console.station.station import ControlStation
from pa_console.views.session_views import shown_sha256
from tests.fleets.keyring import KEYS, PUBLIC, RULES, TO_SOUTH
from tests.mission.gate import send
from tests.mission.test_two_people import BOOK, Site, decision_on, request

NOW = datetime(2026, 1, 1, tzinfo=UTC)
GOOD = ("bob", "cleo")
TRUE = ("asked for", "asked for", "own claims")
WRONG = ("plan", "session", "request", "station", "rules", "orders", "late", "early", "bits", "cut")


class Waiting:
    """A station at which ann sits and a plan waits for two people, and the session for clients."""

    def __init__(self, kind: str = "block") -> None:
        self.site, self.asked = Site(), request(1, kind)
        self.rulebook, self._given = BOOK, asyncio.Queue[Decision]()
        self.state = SessionState()
        self.session = ServedSession(
            cast(ControlStation, self), self.state, lambda: None, authority=self.site.authority
        )
        mission = Mission(id="M1", text="Block the gate.", created=NOW)
        for data in (ev.MissionReceived(mission=mission, position=0), ev.MissionStarted()):
            self.emit(data)
        context = SimpleNamespace(
            services=SimpleNamespace(gate=self.site.gate, rulebook=BOOK),
            mission=SimpleNamespace(standing=None, agent=""),
            emit=self.emit,
            stopwatch=Stopwatch(),
        )
        self.decided = asyncio.create_task(answered(cast(Any, context), self.asked, self._decide))

    async def _decide(self) -> Decision:
        return await self._given.get()

    def emit(self, data: ev.EventPayload) -> None:
        """Tell of something that happens in the mission."""
        event = ev.Event(t=NOW, tick=0, mission="M1", data=data)
        self.state.apply(event)
        self.session.take(event)

    def decide(self, decision: Decision) -> None:
        """Take a decision of whoever sits here."""
        self._given.put_nowait(decision)

    def countersign(self, signed: PlanCountersignature) -> None:
        """Take a signature from elsewhere."""
        self._given.put_nowait(countersignature(signed))

    def acknowledge(self, alarm_id: str, by: str) -> None:
        """Tell that `by` has seen an alarm."""
        self.emit(ev.AlarmAcknowledged(alarm_id=alarm_id, by=by))

    async def approve(self) -> None:
        """Let ann approve over HTTP."""
        await self.session.decide(Bearer("ann", "operator"), self.approval)

    @property
    def approval(self) -> DecisionBody:
        """The body with which ann approves."""
        shown = self.session.waiting
        plain = decision_on(self.asked)
        return DecisionBody(
            kind="approve",
            request_id=self.asked.request_id,
            shown_sha256=shown_sha256(shown[1]) if shown else "0" * 64,
            reason="seen",
            override_judge=plain.override_judge,
            acknowledged=plain.acknowledged,
        )

    def signature(self, key: str, person: str, way: str) -> str:
        """Return what the holder of a key sends as the signature of `person`."""
        if way == "asked for":
            unsigned = self.session.to_sign(self.asked.request_id, person)
            return auth.UnsignedApproval.read(unsigned.to_sign).signed(KEYS[key])
        said = approval_of(
            request(1, "move") if way == "plan" else self.asked,
            person=person,
            station=PUBLIC["south" if way == "station" else "north"],
            session="other" if way == "session" else "S",
            rules="f" * 64 if way == "rules" else RULES,
        )
        if way == "request":
            said = replace(said, request="M9.1")
        if way == "orders":
            said = replace(said, orders=("Ugv_T01 return_to_base",))
        off = {"late": -auth.APPROVAL_S * 2, "early": auth.APPROVAL_S}.get(way, 0.0)
        signed = auth.sign_approval(KEYS[key], said, self.site.clock.at + off)
        return {"bits": signed[:-4] + "AAAA", "cut": signed[:-9]}.get(way, signed)


@asynccontextmanager
async def waiting(kind: str = "block") -> AsyncGenerator[Waiting]:
    found = Waiting(kind)
    while found.session.waiting is None:
        await asyncio.sleep(0)
    try:
        yield found
    finally:
        found.decided.cancel()


PEOPLE = ("ann", *GOOD, "otto", "gone", "eve")
ACTS = st.one_of(
    st.sampled_from(("approve", "approve", "revoke bob", "takeover")),
    st.tuples(
        st.sampled_from(PEOPLE), st.sampled_from(PEOPLE), st.sampled_from((*TRUE * 4, *WRONG))
    ),
    st.sampled_from(GOOD).map(lambda name: (name, name, "asked for")),
)
Act = str | tuple[str, str, str]


@settings(max_examples=400, deadline=None)
@given(st.sampled_from(("block", "away", "override", "acknowledge")), st.lists(ACTS, max_size=8))
def test_no_history_of_requests_sends_what_two_people_have_not_signed(
    kind: str, acts: list[Act]
) -> None:
    asyncio.run(_history(kind, acts))


async def _history(kind: str, acts: list[Act]) -> None:
    async with waiting(kind) as one:
        here, signed, revoked, relieved = False, set[str](), False, False
        for act in acts:
            refused = False
            open_before = not one.decided.done()
            try:
                match act:
                    case "approve":
                        await one.approve()
                    case "revoke bob":
                        keys = [PUBLIC[name] for name in ("gone", "lost", "bob")]
                        one.site.authority.take(auth.sign_revocation(KEYS["owner"], 2, keys))
                        revoked = True
                    case "takeover":
                        assert one.site.authority.take(TO_SOUTH) == ""
                        relieved = True
                    case (key, person, way):
                        body = SignatureBody(person=person, signed=one.signature(key, person, way))
                        await one.session.countersign(one.asked.request_id, body)
                    case _:
                        raise AssertionError(act)
            except ProblemError as problem:
                refused = problem.details.status in (403, 409)
            here |= act == "approve" and open_before and not relieved
            if isinstance(act, tuple) and open_before:
                key, person, way = act
                true = key == person in GOOD and way in TRUE and not (revoked and key == "bob")
                assert refused == (not true or person in signed)
                signed |= {person} if true else set()
            if revoked:
                signed.discard("bob")
            await asyncio.sleep(0)
            if one.decided.done() and open_before:
                assert here
                assert signed, f"one person has approved {kind}"
                assert not relieved
        if not one.decided.done():
            assert not (here and signed) or revoked or relieved
            return
        decision = one.decided.result().decision
        assert decision.signatures.keys() == {"ann"} | (decision.signatures.keys() & set(GOOD))
        assert len(decision.signatures) >= 2
        if not revoked and not relieved:
            one.site.gate.grant(one.decided.result().request, decision, BOOK)
            sent = send(one.site.gate, device_commands(one.asked.plan, one.asked.request_id)[0])
            assert isinstance(sent, ev.CommandSent), "the vehicle has checked both"


@pytest.mark.parametrize(
    ("key", "person", "way", "status", "said"),
    [
        ("eve", "bob", "own claims", 403, "wrong key"),
        ("eve", "eve", "own claims", 403, "'eve' is not in the roster"),
        ("gone", "gone", "own claims", 403, "was revoked"),
        ("otto", "otto", "own claims", 403, "the role observer, which may not approve"),
        ("bob", "bob", "late", 403, "expired"),
        ("bob", "bob", "plan", 403, "bob has signed another plan"),
        ("bob", "bob", "rules", 403, "bob has signed another rules"),
        ("bob", "bob", "request", 403, "bob has signed something else"),
        ("ann", "ann", "own claims", 409, "ann sits at this station"),
    ],
)
async def test_what_does_not_count_is_refused_and_said(
    key: str, person: str, way: str, status: int, said: str
) -> None:
    async with waiting() as one:
        body = SignatureBody(person=person, signed=one.signature(key, person, way))
        with pytest.raises(ProblemError, match=said) as refused:
            await one.session.countersign(one.asked.request_id, body)
        assert refused.value.details.status == status


async def test_a_signature_made_elsewhere_completes_what_was_approved_here(tmp_path: Path) -> None:
    async with waiting() as one:
        tokens = TokenBook(tmp_path / "tokens.json")
        bob, olaf = tokens.make("bob", "operator"), tokens.make("olaf", "observer")
        ann = tokens.make("ann", "operator")
        app = make_app(one.session, tokens, lambda error: pytest.fail(str(error)))
        transport = httpx.ASGITransport(app=app)
        async with httpx.AsyncClient(transport=transport, base_url="http://here") as client:

            async def ask(method: str, path: str, token: str, **how: Any) -> httpx.Response:
                headers = {"Authorization": f"Bearer {token}"}
                return await client.request(method, path, headers=headers, **how)

            path = f"/v1/plans/{one.asked.request_id}"
            asked = (await ask("GET", f"{path}/approval", bob)).json()
            assert asked["orders"] == ["Ugv_T01 block EastGate", "Ugv_T01 return_to_base"]
            assert (asked["person"], asked["station"]) == ("bob", "north")
            signed = auth.UnsignedApproval.read(asked["to_sign"]).signed(KEYS["bob"])
            body = {"person": "bob", "signed": signed}
            assert (await ask("POST", f"{path}/signatures", olaf, json=body)).status_code == 403
            first = await ask("POST", f"{path}/signatures", bob, json=body)
            assert first.json() == {
                "accepted": False,
                "detail": "block needs 2 people to approve, so far there is 1",
                "by": "bob at another station",
            }
            again = await ask("POST", f"{path}/signatures", bob, json=body)
            assert (again.status_code, again.json()["type"][-14:]) == (409, "signed-already")
            stale = await ask("GET", "/v1/plans/M9.1/approval", bob)
            assert (stale.status_code, "no longer waits" in stale.json()["detail"]) == (409, True)
            for name, kind in (("otto", "may-not-sign"), ("zoe", "may-not-sign")):
                told = (await ask("GET", f"{path}/approval?person={name}", bob)).json()
                assert told["type"].endswith(kind)
            body = json.loads(one.approval.model_dump_json())
            last = await ask("POST", "/v1/decisions", ann, json=body)
            assert last.json()["accepted"]
        assert set((await one.decided).decision.signatures) == {"ann", "bob"}


async def test_where_one_person_is_enough_nobody_is_asked_to_sign() -> None:
    async with waiting("move") as one:
        with pytest.raises(ProblemError, match="the approval of ann is enough"):
            one.session.to_sign(one.asked.request_id, "bob")
