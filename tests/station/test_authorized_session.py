"""A session with keys: simulated vehicles move by nothing but what a person has signed."""

from dataclasses import replace

import pytest

from pa_console.fleets import authorization as auth
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.fleets.station_authority import Keys, StationAuthority, Vehicles
from pa_console.mission.approval import Approver, standing_approver
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.session.state import MissionTrace, SessionState
from pa_console.station.assembly import Site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.headless import run_missions
from pa_console.station.station import ControlStation
from tests.fleets.keyring import KEYS, PUBLIC, ROSTER, TO_NORTH, TO_SOUTH
from tests.scripted import FAILURE, ScriptedEngine, plan

ORDER = "Send Drone_T04 to the West Gate."
MOVE = plan(("Drone_T04", "move_to WestGate"))
STRAY = DeviceCommand(command_id="x", agent="Drone_T04", verb="move_to", target="EastGate")


def authority_of(site: Site, asked: dict[str, int] | None = None) -> StationAuthority:
    """The keys of a site at which the shipped rules are enrolled, and ask that."""
    rules = auth.EnrolledRules("checkpoint", asked or {})
    roster = replace(ROSTER, serial=2, rules={site.rulebook.seal.content_sha256: rules})
    messages = (auth.sign_roster(KEYS["owner"], roster), TO_NORTH)
    return StationAuthority(Keys(KEYS["north"], "ann", KEYS["ann"], PUBLIC["owner"], messages))


class Session:
    """One mission, and everything that was told of it."""

    def __init__(self, site: Site, authority: StationAuthority, *verdicts: str) -> None:
        engine = ScriptedEngine([MOVE], verdicts) if verdicts else ScriptedEngine([MOVE])
        self.authority = authority
        self.station: ControlStation = open_station(
            site, engine.engine(), SteppedClock(), authority=authority
        )
        self.told: list[ev.EventPayload] = []

    async def run(
        self, approver: Approver | None = None, takeover: type | None = None
    ) -> MissionTrace:
        """Carry the mission out; another station takes over at the first event `takeover`."""

        def sink(event: ev.Event, _: SessionState) -> None:
            self.told.append(event.data)
            if takeover is not None and isinstance(event.data, takeover):
                self.authority.take(TO_SOUTH)

        decide = approver or standing_approver("auto")
        return (await run_missions(self.station, [ORDER], decide, sink))[0]

    def of(self, kind: type) -> list[ev.EventPayload]:
        """Return the events of one kind."""
        return [payload for payload in self.told if isinstance(payload, kind)]


async def test_a_mission_is_carried_out_with_the_signature_of_whoever_approved(site: Site) -> None:
    session = Session(site, authority_of(site))
    trace = await session.run()
    assert trace.status == "verified", trace.reason
    [made] = session.of(ev.DecisionMade)
    assert isinstance(made, ev.DecisionMade)
    approval, key = session.authority.trust.approval(
        "ann", made.decision.signatures["ann"], session.authority.now()
    )
    assert (approval["kind"], key) == ("standing", PUBLIC["ann"])
    assert "Drone_T04 move_to WestGate" in approval["orders"]


def test_what_nobody_approved_is_refused_by_the_vehicle_itself(site: Site) -> None:
    fleet, authority = SimulatedFleet.start(site.world), authority_of(site)
    authority.begin("S", lambda: "", lambda: fleet.time_s)
    keys = authority.keys
    vehicles = Vehicles(site.world.assets, keys.owner, keys.messages, authority.now)
    fleet.use(authority.authorize, vehicles.verify)
    fleet.send(STRAY)
    fleet.send(STRAY.model_copy(update={"command_id": "h", "verb": "hold", "target": None}))
    told = [reply for _ in range(20) for reply in fleet.step().replies]
    assert [(reply.command_id, reply.status, reply.detail) for reply in told[:2]] == [
        ("x", "refused", "it has no authorization"),
        ("h", "acknowledged", ""),
    ]


async def test_rules_that_are_not_enrolled_block_every_plan(site: Site) -> None:
    authority = authority_of(replace_rules(site))
    session = Session(site, authority)
    trace = await session.run()
    assert (trace.status, trace.commands) == ("held", {})
    assert "enrol them with" in trace.reason
    assert any(isinstance(told, ev.Noticed) and told.subject == "keys" for told in session.told)


def replace_rules(site: Site) -> Site:
    book = site.rulebook.sealed(site.rulebook.seal.model_copy(update={"content_sha256": "f" * 64}))
    return replace(site, rulebook=book)


@pytest.mark.parametrize("moment", [ev.MissionStarted, ev.ApprovalRequested, ev.CommandSent])
async def test_a_station_that_was_relieved_moves_nobody_and_says_so(
    site: Site, moment: type
) -> None:
    session = Session(site, authority_of(site))
    trace = await session.run(takeover=moment)
    said = "this station is not in command: south is in command since epoch 2"
    if moment is ev.CommandSent:
        assert trace.status == "verified", "what a vehicle has begun it ends"
    else:
        assert trace.commands == {}
        assert said in trace.reason


async def test_overriding_the_judge_takes_two_people_and_the_second_may_sit_elsewhere(
    site: Site,
) -> None:
    asked = {"override": 2}
    session = Session(two_people(site), authority_of(site, asked), FAILURE)
    bob = StationAuthority(replace(session.authority.keys, person="bob", own=KEYS["bob"]))
    bob.begin(session.station.session, lambda: "", session.authority.now)
    said: list[str] = []

    def decide(request: ev.ApprovalRequested) -> Decision:
        told = Decision(kind="approve", by="ann", reason="seen", override_judge=True)
        if not said:
            said.append("ann")
            return told
        own = bob.signed(request, told, two_people(site).rulebook)
        return own.model_copy(update={"by": "bob"})

    trace = await session.run(decide)
    made = [told for told in session.told if isinstance(told, ev.DecisionMade)]
    assert [(one.decision.by, one.accepted) for one in made] == [("ann", False), ("ann, bob", True)]
    assert made[0].detail == "overriding the judge needs 2 people to approve, so far there is 1"
    assert set(made[1].decision.signatures) == {"ann", "bob"}
    assert trace.status == "verified", trace.reason


def two_people(site: Site) -> Site:
    rule_set = site.rulebook.rule_set
    assert rule_set is not None
    book = site.rulebook.sealed(site.rulebook.seal)
    book.rule_set = rule_set.model_copy(update={"approvals": {"override": 2}})
    return replace(site, rulebook=book)
