"""Assembly of a station from the names of a world, a rule file and a model.

The world and rules of a recorded session are found by the hashes in its log.
"""

import hashlib
import secrets
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from pa_console import __version__
from pa_console.fleets.fleet import Fleet, Simulated
from pa_console.fleets.simulated import SimulatedFleet
from pa_console.llm.local.engine import SessionEngine
from pa_console.llm.remote.servers import NO_SERVERS, Servers
from pa_console.llm.roles.grammar import plan_grammar
from pa_console.mission.context import Services
from pa_console.policy.expressions.deadlines import DEADLINE_S
from pa_console.policy.pinned_rules import RulesPins
from pa_console.policy.retriever import DEFAULT_METHOD, Retriever
from pa_console.policy.rule_seal import refuse_altered
from pa_console.policy.rulebook import Rulebook, load_rules, with_core
from pa_console.resources import existing_data, find_data
from pa_console.schema.document import DocumentError, read_bytes
from pa_console.schema.evaluation import Variant
from pa_console.schema.events.event import SessionStarted
from pa_console.schema.plan import MAX_ACTIONS
from pa_console.schema.world import World
from pa_console.sim.worlds.scenario_file import LoadedScenario
from pa_console.sim.worlds.world_file import open_world
from pa_console.station.clock import Clock
from pa_console.station.earlier.unclosed_session import ResumedSession
from pa_console.station.rules_in_force import RulesWatch
from pa_console.station.station import ControlStation

if TYPE_CHECKING:
    from pa_console.fleets.station_authority import StationAuthority

PINNED_PACKAGES = ("llama-cpp-python", "llguidance", "pymunk", "common-expression-language")
WORLD_FILE = "world.yaml"


@dataclass(frozen=True)
class Site:
    """A world and the rules in force there, with the paths of their files.

    `rules_path` is None if the rules are not from a file.
    """

    world: World
    world_path: Path
    rulebook: Rulebook
    rules_path: Path | None = None

    @property
    def world_sha256(self) -> str:
        """The SHA-256 of the world file."""
        return hashlib.sha256(read_bytes(self.world_path)).hexdigest()

    @cached_property
    def retriever(self) -> Retriever:
        """The retriever with the default method, indexed once for all stations of the site."""
        return Retriever(self.rulebook.rules)

    def retriever_by(self, method: str) -> Retriever:
        """Return a retriever that uses `method`; raises ValueError for an unknown method."""
        if method == DEFAULT_METHOD:
            return self.retriever
        return Retriever(self.rulebook.rules, method)


def open_rules(
    name: str,
    *,
    unsigned: bool = False,
    pins: RulesPins | None = None,
    accept: bool = False,
    deadline_s: float = DEADLINE_S,
) -> tuple[Rulebook, Path]:
    """Load rules by installed name or path; return them with the path of their file.

    The core rules are added. A check may take at most `deadline_s` seconds. Raises DocumentError if
    the rules cannot be read, AlteredRulesError if they were altered after signing and `unsigned` is
    False, and, with `pins`, RefusedRulesError if they are weaker than the earlier rules and the
    operator did not choose to `accept` them.
    """
    path = existing_data("rules", name, "rules.yaml")
    rulebook = load_rules(path, deadline_s)
    if not unsigned:
        refuse_altered(path, rulebook.seal)
    if pins is not None:
        seal = pins.admit(rulebook.name, rulebook.seal, accept=accept or unsigned)
        rulebook = rulebook.sealed(seal)
    return with_core(rulebook, deadline_s), path


def load_site(
    world: str,
    rules: str,
    *,
    unsigned: bool = False,
    pins: RulesPins | None = None,
    accept: bool = False,
    deadline_s: float = DEADLINE_S,
) -> Site:
    """Load a world and rules by installed name or path; see `open_world` and `open_rules`."""
    loaded, world_path = open_world(world)
    rulebook, rules_path = open_rules(
        rules, unsigned=unsigned, pins=pins, accept=accept, deadline_s=deadline_s
    )
    return Site(loaded, world_path, rulebook, rules_path)


def new_session_id() -> str:
    """Return a new session id; ids sort by time."""
    return f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{secrets.token_hex(2)}"


def open_station(
    site: Site,
    engine: SessionEngine,
    clock: Clock,
    *,
    seed: int = 0,
    readonly: bool = False,
    keep_engine: bool = False,
    scenario: LoadedScenario | None = None,
    respond: bool = False,
    variant: Variant | None = None,
    fleet: Fleet | None = None,
    watch: RulesWatch | None = None,
    read_unasked: bool = True,
    resumed: ResumedSession | None = None,
    authority: "StationAuthority | None" = None,
    servers: Servers = NO_SERVERS,
) -> ControlStation:
    """Return a station on `site` whose planner and judge are two roles on `engine`.

    The engine is closed with the session unless `keep_engine`. With `respond`, alarms become
    missions automatically. Without a `fleet`, the station has its own simulated fleet, which begins
    with `seed` and `scenario`. An evaluation may pass a `variant` of the pipeline. With `watch`,
    the rule file is loaded again when it changes. Without `read_unasked`, the model reads ahead
    only while an operator types. A `resumed` session continues with its own fleet, seed and
    scenario.

    With an `authority`, approvals and commands are signed. The station's simulated vehicles then
    verify the signatures; a `fleet` from the caller gets its tokens from the authority. Models on
    `servers` are asked before the engine's model, which takes over if they do not answer. Raises
    ValueError if a `scenario` is given for a fleet that is not simulated.
    """
    now = time.time
    if resumed is not None:
        fleet, scenario = resumed.fleet, None
        if authority is not None:
            now = _use_keys(resumed.fleet, authority)
    if fleet is None:
        played = scenario.scenario if scenario is not None else None
        fleet = SimulatedFleet.start(site.world, seed, played)
        if authority is not None:
            now = _use_keys(fleet, authority)
    elif scenario is not None and not isinstance(fleet, Simulated):
        raise ValueError(f"scenario {scenario.scenario.name} is for a simulated fleet only")
    variant = variant or Variant()
    retriever = site.retriever_by(variant.method or DEFAULT_METHOD)
    services = Services.open(
        fleet,
        site.rulebook,
        engine,
        variant,
        retriever=retriever,
        authority=authority,
        servers=servers,
    )
    if resumed is not None:
        services = replace(services, sightings=resumed.sightings, pursuits=resumed.pursuits)
    grammar = plan_grammar(site.world, fleet.picture(), tuple(site.world.assets)[:MAX_ACTIONS])
    reader = engine.model.second_reader
    started = (
        resumed.before.started
        if resumed is not None
        else SessionStarted(
            session=new_session_id(),
            version=__version__,
            world=site.world.name,
            world_sha256=site.world_sha256,
            rules=site.rulebook.name,
            rules_sha256=site.rulebook.sha256,
            rules_seal=site.rulebook.seal,
            model=engine.model.name,
            model_sha256=engine.model.sha256,
            seed=fleet.seed if isinstance(fleet, Simulated) else seed,
            scenario=scenario.scenario.name if scenario is not None else "",
            scenario_sha256=scenario.sha256 if scenario is not None else "",
            sampler=engine.sampler,
            grammar_sha256=hashlib.sha256(grammar.encode()).hexdigest(),
            variant=variant,
            readonly=readonly,
            packages={name: version(name) for name in PINNED_PACKAGES},
            adapters={adapter.path.name: adapter.sha256 for adapter in engine.model.adapters},
            second_reader=reader.name if reader is not None else "",
            second_reader_sha256=reader.fingerprint if reader is not None else "",
            servers=servers.named,
        )
    )
    if authority is not None:
        authority.begin(started.session, lambda: services.journal.head, now)
    return ControlStation(
        services,
        clock,
        started,
        readonly=readonly,
        keep_engine=keep_engine,
        respond=respond,
        watch=watch,
        read_unasked=read_unasked,
        resumed=resumed,
    )


def _use_keys(fleet: SimulatedFleet, authority: "StationAuthority") -> Callable[[], float]:
    """Make simulated vehicles verify their commands; return the clock of vehicles and station.

    The clock follows the simulation, so a token is valid for the same simulated time at any rate.
    """
    from pa_console.fleets.station_authority import Vehicles  # noqa: PLC0415 - only with keys

    begun = time.time()

    def now() -> float:
        return begun + fleet.time_s

    keys = authority.keys
    vehicles = Vehicles(fleet.world.assets, keys.owner, keys.messages, now)
    fleet.use(authority.authorize, vehicles.verify)
    return now


def has_rules_of(started: SessionStarted, book: Rulebook) -> bool:
    """Return whether `book` has exactly the rules of a session: an equal file or content hash."""
    content = started.rules_seal.content_sha256 if started.rules_seal is not None else None
    return book.sha256 == started.rules_sha256 or book.seal.content_sha256 == content


class SessionSites:
    """The worlds and rules of recorded sessions, found by their hashes.

    Given files, installed files and worlds near a log are searched. The folder of an evaluation has
    `logs` and `worlds`, so the worlds of its logs are found.
    """

    def __init__(self, worlds: Iterable[str] = (), rules: Iterable[str] = ()) -> None:
        """Search `worlds` and `rules`, which are paths or installed names.

        A folder of worlds is searched as well.
        """
        self._given = tuple(worlds)
        self._rules = tuple(rules)
        self._hashes: dict[Path, str] = {}
        self._worlds: dict[str, World] = {}
        self._books: dict[Path, Rulebook] = {}

    def world_of(self, started: SessionStarted, log: Path) -> World:
        """Return the world of a session.

        Raises ValueError if no file with its hash is found, and DocumentError if the file can no
        longer be loaded.
        """
        if started.world_sha256 not in self._worlds:
            path = self.world_file(started, log)
            if path is None:
                raise ValueError(
                    f"no file has the world {started.world!r} as it was in this session "
                    f"(SHA-256 {started.world_sha256[:12]}); give its file with --world"
                )
            self._worlds[started.world_sha256] = open_world(str(path))[0]
        return self._worlds[started.world_sha256]

    def world_file(self, started: SessionStarted, log: Path) -> Path | None:
        """Return the file of a session's world; None if no file with its hash is found."""
        files = self._files(started, log)
        return next((path for path in files if self._hash(path) == started.world_sha256), None)

    def rules_of(self, started: SessionStarted) -> Rulebook | None:
        """Return the rules of a session; None if no unchanged rules are found."""
        for name in (*self._rules, started.rules):
            path = find_data("rules", name, "rules.yaml")
            if not path.is_file():
                continue
            if path not in self._books:
                self._books[path] = load_rules(path)
            book = self._books[path]
            if has_rules_of(started, book):
                return book
        return None

    def _files(self, started: SessionStarted, log: Path) -> Iterator[Path]:
        for name in self._given:
            yield from _world_files(find_data("worlds", name, WORLD_FILE))
        yield from _world_files(find_data("worlds", started.world, WORLD_FILE))
        yield from _world_files(log.parent.parent / "worlds")

    def _hash(self, path: Path) -> str:
        """Return the SHA-256 of a file; '' if the file cannot be read."""
        if path not in self._hashes:
            self._hashes[path] = ""
            with suppress(DocumentError):
                self._hashes[path] = hashlib.sha256(read_bytes(path)).hexdigest()
        return self._hashes[path]


def _world_files(place: Path) -> Iterator[Path]:
    if place.is_file():
        yield place
    elif place.is_dir():
        yield from sorted(place.glob(f"*/{WORLD_FILE}"))
        yield from sorted(place.glob("*.yaml"))
