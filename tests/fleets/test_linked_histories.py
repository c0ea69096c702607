"""Random histories of links that die and return, lie and repeat themselves: what never happens."""

import math
from dataclasses import dataclass, field
from random import Random
from typing import get_args

from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.fleets.link import DeviceAnswer, LinkNews, LinkNotice
from pa_console.fleets.reports import AssetReport, ContactReport, SensorReport
from pa_console.mission.gate import CommandGate
from pa_console.mission.stop import STANDS_MPS, EmergencyStop
from pa_console.mission.verify import verify_plan
from pa_console.resources import find_data
from pa_console.schema.command import FINAL_REPLIES, CommandReply, DeviceCommand, ReplyStatus
from pa_console.schema.plan import Action, Plan
from pa_console.schema.telemetry import Task
from pa_console.session.log.journal import Journal
from pa_console.sim.worlds.world_file import load_world
from tests.fleets.scripted_link import EPOCH, Desk, ScriptedLink

WORLD = load_world(find_data("worlds", "checkpoint", "world.yaml"))
TEAMS = (("Drone_T01", "Drone_T02"), ("Ugv_T01", "Robot_T01"))
SMALL = WORLD.model_copy(
    update={"assets": {name: WORLD.assets[name] for team in TEAMS for name in team}}
)
HERE, ELSEWHERE = "EastGate", "Base"
STATUSES: tuple[ReplyStatus, ...] = get_args(ReplyStatus)
TASKS: tuple[Task, ...] = get_args(Task)


@dataclass
class History:
    """A station with two links, and what its assets truly sent."""

    random: Random
    desk: Desk = field(init=False)
    links: list[ScriptedLink] = field(init=False)
    stops: EmergencyStop = field(init=False)
    pressed_s: float | None = None
    """When STOP was pressed last, on the station's clock."""
    orders: list[DeviceCommand] = field(default_factory=list[DeviceCommand])
    final: dict[str, CommandReply] = field(default_factory=dict[str, CommandReply])
    """The final reply of each command, by its id."""
    stood_s: dict[str, float] = field(default_factory=dict[str, float])
    """When each asset last sent a report that it stands, and may have been heard."""
    reported_s: dict[str, float] = field(default_factory=dict[str, float])
    """When each asset last sent a report that may have been heard."""

    def __post_init__(self) -> None:
        self.links = [ScriptedLink(f"link:{n}", team) for n, team in enumerate(TEAMS)]
        self.desk = Desk(SMALL, *self.links)
        self.stops = EmergencyStop(self.desk.fleet, CommandGate(self.desk.fleet, Journal()))

    def step(self) -> None:
        """Let one step pass and check what holds at any time."""
        self.desk.time.steps += 1
        fleet = self.desk.fleet
        received = fleet.step()
        for reply in received.replies:
            assert reply.agent in SMALL.assets
            if reply.status in FINAL_REPLIES:
                self.final.setdefault(reply.command_id, reply)
        list(self.stops.step((fleet.tick, received.replies)))
        for asset in fleet.picture().assets.values():
            assert asset.stamp_s <= fleet.time_s
        if self.pressed_s is not None and not self.stops.waiting:
            for name in SMALL.assets:
                assert self.stood_s.get(name, -1.0) > self.pressed_s, (
                    f"{name} was not seen to stand"
                )

    def order(self) -> None:
        """Send a new command, or one of those that were sent before."""
        agent = self.random.choice(list(SMALL.assets))
        number = len(self.orders)
        fresh = DeviceCommand(command_id=f"M1.{number}", agent=agent, verb="move_to", target=HERE)
        again = self.orders and self.random.random() < 0.4
        command = self.random.choice(self.orders) if again else fresh
        if not again:
            self.orders.append(fresh)
        self.desk.fleet.send(command)

    def stop(self) -> None:
        """Press STOP: it goes out at once to every asset of every link that works."""
        before = [len(link.sent) for link in self.links]
        self.pressed_s = self.desk.fleet.time_s
        self.stops.hold_all()
        for link, count in zip(self.links, before, strict=True):
            held = {c.agent for c in link.sent[count:] if c.verb == "hold"}
            assert link.problem or held == link.agents

    def answer(self) -> None:
        """Let an asset answer something: a command of its own, of another one, or none."""
        link = self.random.choice(self.links)
        status = self.random.choice(STATUSES)
        sent = self.random.choice(self.links).sent
        if not sent or self.random.random() < 0.2:
            name = self.random.choice(list(SMALL.assets))
            link.news.append(DeviceAnswer(self.random.choice(("x.1", "M1.0", "")), name, status))
            return
        command = self.random.choice(sent[-6:])
        agent = command.agent if self.random.random() < 0.8 else "Nobody"
        for _ in range(self.random.choice((1, 1, 2))):
            link.news.append(DeviceAnswer(command.command_id, agent, status))

    def obey(self) -> None:
        """Let all assets that can be reached end their last command and stand, for a while."""
        for link in self.links:
            last = {c.agent: number for number, c in enumerate(link.sent)}
            for number in last.values():
                link.answer("done", number=number)
        for _ in range(12):
            self.report(honest=True)
            self.step()

    def report(self, *, honest: bool = False) -> None:
        """Let assets report; without `honest` also of another time, or over another link."""
        for name in SMALL.assets:
            if not honest and self.random.random() < 0.3:
                continue
            link = next(link for link in self.links if name in link.agents)
            age_s = 0.0 if honest else self.random.choice((0.0, 0.0, 0.1, 1.0, 8.0, -1.0, -30.0))
            stands = honest or self.random.random() < 0.8
            moving = 0.0 if stands else self.random.choice((0.4, 3.0))
            task = "holding" if stands else self.random.choice(TASKS)
            at = HERE if honest or self.random.random() < 0.97 else ELSEWHERE
            report = self.desk.report(name, at, age_s, speed_mps=moving, task=task)
            strays = not honest and self.random.random() < 0.1
            over = self.random.choice(self.links) if strays else link
            over.news.append(report)
            if over is link and not link.problem and age_s > -2.0:
                heard_s = self.desk.fleet.time_s - max(age_s, 0.0) + SMALL.dt_s
                self.reported_s[name] = max(self.reported_s.get(name, -1.0), heard_s)
                if moving <= STANDS_MPS:
                    self.stood_s[name] = max(self.stood_s.get(name, -1.0), heard_s)

    def cut(self) -> None:
        """Cut a link, or let it come back."""
        link = self.random.choice(self.links)
        link.problem = "" if link.problem else "cut"

    def check_links(self) -> None:
        """Check everything that ever went out over the links."""
        for link in self.links:
            ids: dict[str, DeviceCommand] = {}
            for command in link.sent:
                assert command.agent in link.agents
                assert ids.setdefault(command.command_id, command) == command
            orders = [(c.agent, c.command_id) for c in link.sent if c.verb != "hold"]
            own = {c.command_id.partition(".")[2] for c in link.sent if c.verb != "hold"}
            assert len(own) == len(set(orders)), "a command went out under two ids"

    def check_verified(self) -> None:
        """Check that no order counts as carried out that telemetry does not show."""
        fleet = self.desk.fleet
        picture = fleet.picture()
        for order in self.orders:
            if (reply := self.final.get(order.command_id)) is None:
                continue
            plan = Plan(
                reason="", actions=(Action(agent=order.agent, command=f"move_to {order.target}"),)
            )
            found = verify_plan(plan, SMALL, picture, picture, {order.agent: reply})
            if found.outcome == "pass":
                ended_s = reply.tick * SMALL.dt_s
                assert reply.status == "done"
                assert self.reported_s[order.agent] >= ended_s - SMALL.dt_s
                assert picture.assets[order.agent].at == order.target


NUMBERS = st.sampled_from((0.0, -1.0, 1e9, 1e308, math.nan, math.inf, "1", None))
NAMES = st.sampled_from((*SMALL.assets, *SMALL.cameras, "Nobody", "", 7, None, [], "x" * 9999))
TIMES = st.sampled_from(
    (EPOCH, EPOCH.replace(tzinfo=None), EPOCH.replace(year=1), EPOCH.replace(year=9999), 0, None)
)
POINTS = st.one_of(st.tuples(NUMBERS, NUMBERS), st.sampled_from(((), None, "xy", (1.0,))))
WORDS = st.one_of(st.sampled_from(("ok", "done", "idle", "alarm", "uav", "x" * 9999)), NAMES)
ANY_CONTACT = st.builds(
    ContactReport, WORDS, st.sampled_from(("vehicle", "tank")), POINTS, NUMBERS, WORDS, WORDS
)
ANY_NEWS = st.one_of(
    st.builds(
        AssetReport, NAMES, TIMES, POINTS, NUMBERS, NUMBERS, WORDS, WORDS, NUMBERS, NAMES,
        manual=st.booleans(), route=st.one_of(st.none(), st.lists(POINTS, max_size=2)),
    ),
    st.builds(SensorReport, NAMES, TIMES, st.lists(ANY_CONTACT, max_size=3),
              st.dictionaries(st.sampled_from(tuple(SMALL.assets)), POINTS, max_size=2)),
    st.builds(DeviceAnswer, NAMES, NAMES, WORDS, WORDS),
    st.builds(LinkNotice, WORDS, NAMES, WORDS),
    NAMES,
)  # fmt: skip


@settings(max_examples=500)
@given(news=st.lists(ANY_NEWS, min_size=1, max_size=6))
def test_whatever_a_link_gives_there_is_a_picture_and_stop_goes_out(news: list[LinkNews]) -> None:
    links = [ScriptedLink(f"link:{n}", team) for n, team in enumerate(TEAMS)]
    desk = Desk(SMALL, *links)
    links[0].news += news
    links[1].news.append(desk.report("Ugv_T01", HERE))
    desk.go(5)
    assert desk.fleet.picture().assets["Ugv_T01"].available
    EmergencyStop(desk.fleet, CommandGate(desk.fleet, Journal())).hold_all()
    assert {c.agent for link in links for c in link.sent} == set(SMALL.assets)


ACTS = (
    History.order,
    History.stop,
    History.answer,
    History.report,
    History.report,
    History.cut,
    History.obey,
)


@settings(max_examples=1000)
@given(seed=st.integers(0, 2**32))
def test_whatever_links_do_nothing_is_sent_twice_or_taken_for_done(seed: int) -> None:
    random = Random(seed)
    history = History(random)
    acts = random.sample(ACTS, random.randrange(3, len(ACTS)))
    for _ in range(random.randrange(5, 20)):
        random.choice(acts)(history)
        for _ in range(random.choice((0, 1, 1, 5))):
            history.step()
    history.check_links()
    history.check_verified()
