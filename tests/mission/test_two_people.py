"""What the rules ask two people for is not sent with the approval of one, whatever happens."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import count

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets import authorization as auth
from pa_console.fleets.station_authority import Keys, StationAuthority, Vehicles
from pa_console.mission.gate import CommandGate
from pa_console.mission.rehearse import device_commands
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Action, Plan
from pa_console.schema.rule import Rule, RuleSet, RulesSeal
from pa_console.session.log.journal import Journal
from tests.fleets.keyring import (
    KEYS,
    PUBLIC,
    REVOCATION,
    ROSTER,
    RULES,
    TO_NORTH,
    TO_SOUTH,
    Clock,
)
from tests.mission.gate import WORLD, send

pytestmark = pytest.mark.invariant

ASKED = {"block": 2, "override": 2, "acknowledge": 2}
RULE = Rule(id="ROE-01", domain="ROE", priority="high", text="r")
BOOK = Rulebook(
    "two people",
    "",
    (),
    seal=RulesSeal(content_sha256=RULES),
    rule_set=RuleSet(name="two people", approvals=ASKED, rules=(RULE,)),
)
MESSAGES = (
    auth.sign_roster(
        KEYS["owner"],
        auth.Roster(
            2, ROSTER.people, ROSTER.stations, {RULES: auth.EnrolledRules("two people", ASKED)}
        ),
    ),
    REVOCATION,
    TO_NORTH,
)


def keys_of(person: str, messages: tuple[str, ...] = MESSAGES) -> Keys:
    return Keys(KEYS["north"], person, KEYS[person], PUBLIC["owner"], messages)


@dataclass
class Link:
    """A link to vehicles that check what they get, with the token that went out with it."""

    authority: StationAuthority
    clock: Clock
    world = WORLD
    sent: list[DeviceCommand] = field(default_factory=list[DeviceCommand])

    def __post_init__(self) -> None:
        vehicles = Vehicles(("Ugv_T01",), PUBLIC["owner"], MESSAGES, self.clock)
        self.verify = vehicles.verify

    def send(self, command: DeviceCommand) -> None:
        """Note the command, which its vehicle must take, unless it has it already."""
        token = self.authority.authorize(command)
        if command.verb != "hold" and command not in self.sent:
            assert self.verify(token, command) == ""
        self.sent.append(command)


@dataclass
class Site:
    """A station at which ann sits, and what bob, cleo and others sign elsewhere."""

    clock: Clock = field(default_factory=Clock)

    def __post_init__(self) -> None:
        self._stations: dict[str, StationAuthority] = {}
        self.authority = self._at("ann")
        self.link = Link(self.authority, self.clock)
        self.gate = CommandGate(self.link, Journal(), self.authority)  # pyright: ignore[reportArgumentType]

    def _at(self, person: str) -> StationAuthority:
        if person not in self._stations:
            authority = StationAuthority(keys_of(person), WORLD.assets)
            authority.begin("S", lambda: "head", self.clock)
            self._stations[person] = authority
        return self._stations[person]

    def signature(self, name: str, request: ev.ApprovalRequested) -> str:
        """What `name` signs of `request`; a name such as `bob as cleo` is a forged one."""
        signer = self._at(name.partition(" as ")[0])
        return next(iter(signer.signed(request, decision_on(request), BOOK).signatures.values()))

    def decision(self, names: Iterable[str], request: ev.ApprovalRequested) -> Decision:
        """Return the decision that all of `names` have signed."""
        signed = {name.split(" as ")[-1]: self.signature(name, request) for name in names}
        return decision_on(request).model_copy(update={"signatures": signed})


def decision_on(request: ev.ApprovalRequested) -> Decision:
    return Decision(
        kind="approve",
        reason="seen",
        override_judge=request.needs_override,
        acknowledged=request.acknowledge,
    )


def request(number: int, kind: str) -> ev.ApprovalRequested:
    command = "block EastGate" if kind == "block" else "move_to EastGate"
    away = "block WestGate" if kind == "away" else "return_to_base"
    return ev.ApprovalRequested(
        request_id=f"M{number}.1",
        attempt=1,
        plan=Plan(reason="r", actions=(Action(agent="Ugv_T01", command=command),)),
        if_halted=(Action(agent="Ugv_T01", command=away),),
        needs_override=kind == "override",
        acknowledge=("WF-06",) if kind == "acknowledge" else (),
    )


NEEDS = {"move": 1, "block": 2, "away": 2, "override": 2, "acknowledge": 2}
LEGITIMATE = ("ann", "bob", "cleo")
SIGNERS = (*LEGITIMATE, "otto", "gone", "eve", "ann as bob", "eve as cleo", "bob as ann")
ACTS = st.one_of(
    st.tuples(
        st.just("approve"),
        st.sampled_from(tuple(NEEDS)),
        st.lists(st.sampled_from(SIGNERS), unique=True, max_size=4),
        st.sampled_from(("fresh", "fresh", "fresh", "of another plan", "late")),
    ),
    st.sampled_from(("send", "send", "resend", "halt", "finish", "stop", "release", "takeover")),
)


@settings(max_examples=300, deadline=None)
@given(st.lists(ACTS, max_size=8))
def test_in_any_history_no_command_goes_out_with_fewer_approvals_than_it_needs(
    acts: list[str | tuple[str, str, list[str], str]],
) -> None:
    site, numbers = Site(), count(1)
    gate, link = site.gate, site.link
    asked, people, taken = request(0, "block"), 0, False
    for act in acts:
        before = len(link.sent)
        match act:
            case ("approve", kind, names, how):
                waiting = request(next(numbers), kind)
                about = request(99, kind) if how == "of another plan" else waiting
                ago_s = auth.APPROVAL_S * 2 if how == "late" else 0.0
                site.clock.at += 1.0 - ago_s
                decision = site.decision(names, about)
                site.clock.at += ago_s
                signers = {name.split(" as ")[-1]: name for name in names}
                good = [name for name, signer in signers.items() if name == signer in LEGITIMATE]
                enough = len(good) if how == "fresh" else 0
                may = enough >= NEEDS[kind] and not gate.stopped and not taken
                if may:
                    gate.grant(waiting, decision, BOOK)
                    asked, people = waiting, enough
                else:
                    with pytest.raises(ValueError, match=r"\S"):
                        gate.grant(waiting, decision, BOOK)
            case "send" | "resend":
                ordered = device_commands(asked.plan, asked.request_id)[0]
                word = asked.if_halted[0]
                away = DeviceCommand(
                    command_id=f"{asked.request_id}.halt", agent=word.agent, verb=word.verb,
                    target=word.target,
                )  # fmt: skip
                for command in (ordered, away):
                    if act == "send":
                        send(gate, command)
            case "halt":
                gate.halt()
            case "finish":
                gate.finish()
            case "stop":
                for hold in gate.stop_all():
                    assert isinstance(send(gate, hold), ev.CommandSent), "a stop waits for nobody"
            case "release" if gate.stopped:
                gate.release()
            case "takeover":
                assert site.authority.take(TO_SOUTH) == ""
                taken = True
            case _:
                pass
        for command in link.sent[before:]:
            if command.verb == "hold":
                continue
            assert not taken
            assert not gate.stopped
            needs = [ASKED.get(command.verb, 1), *(2 for _ in asked.acknowledge)]
            assert people >= max(*needs, 2 if asked.needs_override else 1)


def test_the_second_person_completes_what_the_first_began() -> None:
    site, asked = Site(), request(1, "block")
    one = site.decision(("ann",), asked)
    assert site.gate.needed(asked, BOOK) == {"block": 2}
    problem = site.gate.inadmissible(asked, one, BOOK)
    assert problem == "block needs 2 people to approve, so far there is 1"
    both = site.decision(("ann", "bob"), asked)
    assert site.gate.inadmissible(asked, both, BOOK) == ""
    site.gate.grant(asked, both, BOOK)
    sent = send(site.gate, device_commands(asked.plan, asked.request_id)[0])
    assert isinstance(sent, ev.CommandSent)


def test_without_keys_nobody_can_be_the_second_person() -> None:
    site, asked = Site(), request(1, "block")
    gate = CommandGate(site.link, Journal())  # pyright: ignore[reportArgumentType]
    assert "block needs 2 people" in gate.inadmissible(asked, decision_on(asked), BOOK)
    assert "block needs 2 people" in gate.inadmissible(
        asked, site.decision(("ann", "bob"), asked), BOOK
    ), "a signature that nobody can check counts for nothing"


def test_a_station_that_was_relieved_says_so() -> None:
    site, asked = Site(), request(1, "move")
    assert site.authority.take(TO_SOUTH) == ""
    told = site.gate.inadmissible(asked, site.decision(("ann",), asked), BOOK)
    assert told == "this station is not in command: south is in command since epoch 2"


def test_rules_that_are_not_enrolled_are_told_before_a_vehicle_refuses() -> None:
    site, asked = Site(), request(1, "move")
    other = Rulebook("house", "", (), seal=RulesSeal(content_sha256="d" * 64))
    told = site.gate.inadmissible(asked, site.decision(("ann",), asked), other)
    assert "the rules 'house': enrol them with pa-console keys enrol" in told


def test_a_roster_that_its_owner_has_not_signed_is_refused() -> None:
    forged = auth.sign_roster(KEYS["cleo"], ROSTER)
    with pytest.raises(ValueError, match=r"is not valid: .* wrong key"):
        StationAuthority(keys_of("ann", (forged, TO_NORTH)))
