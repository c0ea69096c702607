"""Whatever is lost, late or done at once: no vehicle goes back to a station that was relieved."""

import json
from base64 import urlsafe_b64decode
from collections import deque

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from pa_console.fleets import authorization as auth
from pa_console.fleets.station_authority import Keys, StationAuthority
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events.event import ApprovalRequested
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rule import Rule, RuleSet, RulesSeal
from tests.fleets.keyring import KEYS, PUBLIC, ROSTER, RULES, TO_NORTH, Clock, Vehicle

STATIONS = ("north", "south", "lost")
COMMANDERS = ("ann", "bob", "cleo")
VEHICLES = ("Ugv_T01", "Ugv_T02")
EVERYBODY = (*STATIONS, *VEHICLES)
BOOK = Rulebook(
    "checkpoint",
    "",
    (),
    seal=RulesSeal(content_sha256=RULES),
    rule_set=RuleSet(
        name="checkpoint", rules=(Rule(id="ROE-01", domain="ROE", priority="high", text="r"),)
    ),
)
SIGNED = auth.sign_roster(
    KEYS["owner"],
    auth.Roster(
        2,
        {name: auth.Person(PUBLIC[name], "commander") for name in COMMANDERS},
        {name: PUBLIC[name] for name in STATIONS},
        {RULES: auth.EnrolledRules("checkpoint")},
    ),
)
assert set(STATIONS) == set(ROSTER.stations)
Rank = tuple[int, str]


def station(name: str, clock: Clock) -> StationAuthority:
    """A station at which ann sits; its session is its own."""
    keys = Keys(KEYS[name], "ann", KEYS["ann"], PUBLIC["owner"], (SIGNED, TO_NORTH))
    authority = StationAuthority(keys, VEHICLES)
    authority.begin(f"S-{name}", lambda: "head", clock)
    return authority


class Takeovers(RuleBasedStateMachine):
    """Stations that take command and send, vehicles that check, a broker that loses messages."""

    def __init__(self) -> None:
        super().__init__()
        self.clock, self.number = Clock(), 0
        self.stations = {name: station(name, self.clock) for name in STATIONS}
        self.vehicles = {
            name: Vehicle(name, self.clock, told=(SIGNED, TO_NORTH)) for name in VEHICLES
        }
        self.coming = {name: deque[str]() for name in EVERYBODY}
        """What is on its way to each, in the order of the broker."""
        self.retained, self.all = TO_NORTH, [TO_NORTH]
        self.highest: dict[str, Rank] = dict.fromkeys(VEHICLES, (1, PUBLIC["north"]))

    @rule(name=st.sampled_from(STATIONS), commander=st.sampled_from(COMMANDERS))
    def take_command(self, name: str, commander: str) -> None:
        """A commander takes command at a station, which may not know of the last takeover."""
        authority = self.stations[name]
        authority.take_command(commander, KEYS[commander])
        assert authority.refusal == ""
        self.retained = authority.newest["takeover"]
        self.all.append(self.retained)
        for other, waiting in self.coming.items():
            if other != name:
                waiting.append(self.retained)

    @rule(name=st.sampled_from(EVERYBODY))
    def deliver(self, name: str) -> None:
        """The next message arrives."""
        waiting = self.coming[name]
        if waiting:
            self._hear(name, waiting.popleft())

    @rule(name=st.sampled_from(EVERYBODY))
    def reconnect(self, name: str) -> None:
        """Everything on its way is lost; what is retained comes."""
        self.coming[name].clear()
        self._hear(name, self.retained)

    @rule(name=st.sampled_from(EVERYBODY), data=st.data())
    def replay(self, name: str, data: st.DataObject) -> None:
        """Somebody sends an old takeover again."""
        self._hear(name, data.draw(st.sampled_from(self.all)))

    @rule(name=st.sampled_from(VEHICLES))
    def restart(self, name: str) -> None:
        """A vehicle starts anew with what it has kept."""
        kept = self.vehicles[name].memory
        self.vehicles[name] = Vehicle(name, self.clock, kept, told=())

    @rule(name=st.sampled_from(STATIONS), vehicle=st.sampled_from(VEHICLES))
    def order(self, name: str, vehicle: str) -> None:
        """A station approves a plan and sends its command."""
        self.send(name, vehicle)

    def send(self, name: str, vehicle: str) -> bool:
        """Return whether the vehicle carries out a command of the station."""
        authority = self.stations[name]
        self.number += 1
        self.clock.at += 1.0
        asked = ApprovalRequested(
            request_id=f"M{self.number}.1",
            attempt=1,
            plan=Plan(reason="r", actions=(Action(agent=vehicle, command="move_to EastGate"),)),
        )
        decision = authority.signed(asked, Decision(kind="approve"), BOOK)
        authority.grant(asked, decision, BOOK)
        command = DeviceCommand(
            command_id=f"{asked.request_id}.1", agent=vehicle, verb="move_to", target="EastGate"
        )
        moved = self.vehicles[vehicle].get(authority.authorize(command), command) == ""
        if moved:
            assert self.highest[vehicle][1] == PUBLIC[name], "it was told of another station"
            assert authority.refusal == "", "its own station knows that it is relieved"
        return moved

    def _hear(self, name: str, message: str) -> None:
        if name in self.stations:
            self.stations[name].take(message)
            return
        self.vehicles[name].verifier.take(message)
        self.highest[name] = max(self.highest[name], rank(message))
        trust = self.vehicles[name].verifier.trust.takeover
        assert (trust.epoch, trust.station) == self.highest[name]

    def teardown(self) -> None:
        """Once everybody has heard all, one station moves every vehicle, and no other any."""
        for message in self.all:
            for name in EVERYBODY:
                self._hear(name, message)
        winner = max(map(rank, self.all))[1]
        for name in STATIONS:
            for vehicle in VEHICLES:
                assert self.send(name, vehicle) == (PUBLIC[name] == winner)
            assert (self.stations[name].refusal == "") == (PUBLIC[name] == winner)


def rank(message: str) -> Rank:
    """The epoch and the station of a takeover, by which the later one counts."""
    payload = message.split(".")[1]
    claims = json.loads(urlsafe_b64decode(payload + "=" * (-len(payload) % 4)))
    return int(claims["epoch"]), str(claims["station"])


TestTakeovers = Takeovers.TestCase
TestTakeovers.settings = settings(max_examples=400, stateful_step_count=30, deadline=None)
