"""Who can be sent and who takes part, and why an ask cannot be carried out as it is meant."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

from pa_console.language.canonical.facts import asset_state, sole_covers
from pa_console.language.canonical.order import (
    VERB_FOR,
    Ask,
    Obstacle,
    Task,
    Wrong,
    asset_obstacles,
    obstacle,
)
from pa_console.schema.telemetry import Digest, Picture, Track
from pa_console.schema.world import KINDS, PLAIN_KINDS, AssetKind, World

Command = tuple[str, str]
"""An agent and its command."""
MOST_LISTED = 6
"""More names than these are only counted in a reason."""
MOST_TOLD, MOST_OFFERED = 3, 6
"""More names than these are not told with their states, nor one by one, in a reason."""
MOST_OPTIONS = 4
"""The most ways to serve one ask that are tried."""
FORBIDDEN: Mapping[Wrong, tuple[str, str]] = {
    "force": ("no force", "ROE-01"),
    "skip_identification": ("identify first", "ROE-02"),
    "skip_warning": ("warn first", "ROE-03"),
    "override": ("no order sets rules aside", "ROE-05"),
    "chase": ("nobody leaves the perimeter", "ROE-06"),
    "noncombatants": ("only watch", "ROE-08"),
    "strip": ("gates stay covered", "WF-03"),
}
"""The orders that are refused in every situation, with the rule that forbids them."""
Objection = tuple[str, str]
"""Why not, in words, and the id of the rule."""


class Draft(NamedTuple):
    """One way to serve an ask; without commands and `done` it is refused.

    `why` are the facts that decide, in words; `undone` says that only a part is done.
    """

    ask: Ask
    commands: tuple[Command, ...] = ()
    why: tuple[str, ...] = ()
    rule: str = ""
    done: bool = True
    undone: bool = False

    @property
    def agents(self) -> tuple[str, ...]:
        """Who is addressed."""
        return tuple(agent for agent, _ in self.commands)


@dataclass(frozen=True)
class TakenAssets:
    """Who is taken already while the drafts of one order are made, and who is named in it."""

    used: frozenset[str] = frozenset()
    reserved: frozenset[str] = frozenset()

    def taken(self, own: Sequence[str] = ()) -> frozenset[str]:
        """Return whom an ask must not choose: those used, and those named elsewhere."""
        return self.used | (self.reserved - frozenset(own))


def refusal(ask: Ask, why: str, rule: str) -> Draft:
    """Return that nothing of `ask` is done."""
    return Draft(ask, why=(why,), rule=rule, done=False, undone=True)


def going(agent: str, place: str, world: World) -> Command:
    """Return the command that brings `agent` to `place`."""
    return agent, "return_to_base" if place == world.base else f"move_to {place}"


def goals(commands: Sequence[Command], world: World) -> Mapping[str, str]:
    """Return where every agent that is sent somewhere will be."""
    ends: dict[str, str] = {}
    for agent, command in commands:
        verb, _, frame = command.partition(" ")
        if verb == "return_to_base" or frame:
            ends[agent] = frame or world.base
    return ends


def listed(names: Sequence[str]) -> str:
    """Return a few names in words, or how many there are."""
    return ", ".join(names) if len(names) <= MOST_LISTED else f"{len(names)} assets"


@dataclass(frozen=True)
class Roster:
    """The team as picture and digest show it; only assets of the digest are ever chosen."""

    world: World
    picture: Picture
    digest: Digest
    excluded: Collection[str] = ()
    """Assets that the order rules out: they stay what they are, and are never chosen."""

    def up(self, name: str) -> bool:
        """Whether an asset is there and works."""
        return name in self.picture.assets and self.picture.assets[name].available

    def kind(self, name: str) -> AssetKind:
        """Return the kind of an asset of the world."""
        return self.world.assets[name].kind

    def low(self, name: str) -> bool:
        """Whether its battery is low (CAP-04)."""
        return self.picture.assets[name].low_battery

    def clear(self, name: str) -> bool:
        """Whether its link is good enough for a critical task (CAP-05)."""
        return self.picture.assets[name].comms == "ok"

    def stands(self, name: str) -> str:
        """Return the frame at which an asset has arrived, '' while it is under way."""
        asset = self.picture.assets[name]
        return asset.at if asset.at is not None and asset.at == asset.post else ""

    def alone_at(self, name: str) -> str:
        """Return the gate that only this asset covers, '' for none."""
        gates = (gate for gate, sole in sole_covers(self.picture).items() if sole == name)
        return next(gates, "")

    def there(self, place: str, kinds: Iterable[AssetKind] = KINDS) -> list[str]:
        """Return the assets that are up and stand at `place`, kind after kind."""
        return [
            name
            for kind in kinds
            for name in self.digest.posts
            if self.kind(name) == kind and self.up(name) and self.stands(name) == place
        ]

    def free(
        self, kinds: Iterable[AssetKind], used: Collection[str] = (), origin: str = ""
    ) -> list[str]:
        """Return the free assets, kind after kind and best first; poor links come last."""
        pool = [
            name
            for kind in kinds
            for name in self.digest.free.get(kind, ())
            if name not in (*used, *self.excluded) and (not origin or self.stands(name) == origin)
        ]
        return sorted(pool, key=lambda name: not self.clear(name))

    def every(self) -> list[str]:
        """Return all assets that are up, as the picture lists them."""
        return [name for name in self.digest.posts if self.up(name)]

    def told(self, names: Sequence[str]) -> str:
        """Return the states of a few assets as the compact picture has them."""
        if len(names) > MOST_TOLD:
            return "all of them"
        return ", ".join(f"{name}: {asset_state(self.digest, name)}" for name in names)

    def whereabouts(self, name: str) -> str:
        """Return where an asset stands or goes, as the compact picture has it."""
        return f"{name}: {self.digest.posts[name].partition(' ')[2]}"

    def offered(self, names: Sequence[str], *, short: bool = False) -> str:
        """Return who is taken of the free ones, begun as the compact picture begins its list."""
        kinds = {self.kind(name) for name in names}
        label = f"Free {PLAIN_KINDS[self.kind(names[0])]}" if len(kinds) == 1 else "Free"
        few = ", ".join(names) if len(names) <= MOST_OFFERED else f"{len(names)} assets"
        return f"{label}: {'only ' if short else ''}{few}"

    def bare(self, goals: Mapping[str, str]) -> tuple[str, ...]:
        """Return the gates that are covered now and by nobody once everybody is at its goal."""
        lost: list[str] = []
        for gate, cover in self.picture.gates.items():
            stays = any(goals.get(name, gate) == gate for name in cover.by)
            if cover.covered and not stays and gate not in goals.values():
                lost.append(gate)
        return tuple(lost)

    def strangers(self, place: str) -> list[Track]:
        """Return the tracks at `place` that are not identified; no warning before that (WF-01)."""
        tracks = self.picture.tracks.values()
        return [track for track in tracks if track.gate == place and track.identity == "unknown"]

    def unseen(self, place: str) -> bool:
        """Whether an unknown track at `place` waits for its first look from the air (WF-02)."""
        return any(not track.observed for track in self.strangers(place))

    def track(self, place: str, kind: str, track_id: str) -> Track | None:
        """Return the track that is meant: by its id, else the most urgent one at `place`."""
        named = self.picture.tracks.get(track_id)
        if named is not None:
            return named
        tracks = [t for t in self.picture.tracks.values() if t.gate == place]
        here = [track for track in tracks if track.status != "leaving"]
        alike = [track for track in here if kind in ("", track.kind)]
        return min(alike or here, key=_urgency, default=None)


def _urgency(track: Track) -> tuple[bool, float, str]:
    """Return by what tracks are put in order, the most urgent first."""
    return track.intent != "hostile", track.distance_m, track.id


def objection(ask: Ask, roster: Roster) -> Objection | None:
    """Return why nothing of `ask` can be done; None when at least a part can."""
    if ask.wrong is not None and ask.wrong in FORBIDDEN:
        return FORBIDDEN[ask.wrong]
    found = obstacle(ask, roster.world, lambda name: _obstacle(name, ask, roster))
    return None if found is None else _told(found, ask.task)


def asset_objection(name: str, ask: Ask, roster: Roster) -> Objection | None:
    """Return why the asset of that name cannot do its part of `ask`."""
    found = _obstacle(name, ask, roster)
    return None if found is None else _told(found, ask.task)


def _obstacle(name: str, ask: Ask, roster: Roster) -> Obstacle | None:
    """Return what keeps an asset from its part of `ask`: its kind before its state."""
    found = [*asset_obstacles(name, ask, roster.world, roster.picture)]
    return min(found, key=lambda each: each.problem != "wrong kind", default=None)


def _told(found: Obstacle, task: Task) -> Objection:
    """Return an obstacle in words, and its rule."""
    match found.problem:
        case "closed":
            return "closed zone", "ROE-07"
        case "no place":
            return "no such place", "CAP-06"
        case "no asset":
            return f"{found.subject}: no such asset", "CAP-10"
        case "down":
            return f"{found.subject}: down", "CAP-10"
        case "low":
            return f"{found.subject}: low", "CAP-04"
        case "poor link":
            return f"{found.subject}: poor link", "CAP-05"
        case "wrong kind":
            verb, kind = VERB_FOR[task], found.kind
            rule = "CAP-02" if verb == "block" or kind == "ugv" else "CAP-01"
            word = "assets" if kind is None else f"{PLAIN_KINDS[kind]}s"
            return f"{word} do not {verb}", "CAP-03" if verb == "warn" and kind != "uav" else rule


def named(ask: Ask, desk: TakenAssets, roster: Roster) -> tuple[list[str], tuple[str, ...]]:
    """Return who of those named can do it, and in words why the others cannot."""
    able: list[str] = []
    why: list[str] = []
    for name in ask.who.names:
        problem = asset_objection(name, ask, roster)
        if problem is not None:
            why.append(f"{problem[0]} ({problem[1]})")
        elif name in desk.used:
            why.append(f"{name} has one task already (CAP-07)")
        else:
            able.append(name)
    return able, tuple(why)


def teams(
    ask: Ask, desk: TakenAssets, roster: Roster, kinds: Sequence[AssetKind]
) -> list[tuple[tuple[str, ...], bool]]:
    """Return teams of free assets for the place, best first, and whether they are too few.

    Nobody is in one whose leaving would leave a gate bare, nor who stands there already.
    """
    pool = [
        name
        for name in roster.free(kinds, desk.taken(), ask.who.origin)
        if roster.stands(name) != ask.place
    ]
    wanted = len(pool) if ask.who.count == "all" else ask.who.count
    found: list[tuple[tuple[str, ...], bool]] = []
    for start in range(min(len(pool), MOST_OPTIONS)):
        team: list[str] = []
        for name in (*pool[start:], *pool[:start]):
            if not roster.bare(dict.fromkeys((*team, name), ask.place)) and len(team) < wanted:
                team.append(name)
        chosen = tuple(name for name in pool if name in team)
        if team and (chosen, len(team) < wanted) not in found:
            found.append((chosen, len(team) < wanted and ask.who.count != "all"))
    return found


def only(ask: Ask, names: Sequence[str]) -> Ask:
    """Return `ask` for those of its assets that can do it."""
    return replace(ask, who=replace(ask.who, names=tuple(names)))


def fewer(draft: Draft, roster: Roster) -> list[Draft]:
    """Return `draft` without one of several that a gate depends on, each in turn (WF-03)."""
    return [
        Draft(
            only(draft.ask, [name for name in draft.agents if name != stays]),
            tuple(command for command in draft.commands if command[0] != stays),
            (*draft.why, f"{stays}: alone at {gate} (WF-03) stays"),
            undone=True,
        )
        for stays in draft.agents
        if len(draft.agents) > 1 and (gate := roster.alone_at(stays))
    ]


def so_many(ask: Ask, team: Sequence[str]) -> Ask:
    """Return `ask` for as many assets as there are in `team`."""
    return replace(ask, who=replace(ask.who, count=len(team)))


def none_free(ask: Ask) -> str:
    """Return in words that nobody of the kind that is asked for is free."""
    kind = ask.who.kind
    return f"Free {PLAIN_KINDS[kind]}: none" if kind is not None else "nobody is free"


def guards(ask: Ask, desk: TakenAssets, roster: Roster, place: str) -> list[str]:
    """Return who could guard `place`: those named, else the free ones in the order of use."""
    own = (*ask.who.names, ask.leaving)
    if ask.who.names:
        return [
            name
            for name in ask.who.names
            if asset_objection(name, ask, roster) is None and name not in desk.used
        ][:1]
    kinds = kinds_of(ask)
    if ask.who.kind is not None:
        kinds = tuple(sorted(KINDS, key=lambda kind: kind != ask.who.kind))
    pool = roster.free(kinds, desk.taken(own), ask.who.origin)
    fit = (n for n in pool if n != ask.leaving and roster.stands(n) != place)
    spare = [n for n in fit if not roster.bare({n: place})]
    first = [n for n in spare if roster.clear(n)]
    order = sorted(spare, key=lambda n: (n not in first, kinds.index(roster.kind(n))))
    return list(islice(order, MOST_OPTIONS))


def said_of(able: Sequence[str], why: Sequence[str], roster: Roster) -> tuple[str, ...]:
    """Return why some cannot, then the states of those who can."""
    return (*why, roster.told(able)) if able else tuple(why)


def kinds_of(ask: Ask) -> tuple[AssetKind, ...]:
    """Return the kinds of assets that may serve `ask`."""
    return KINDS if ask.who.kind is None else (ask.who.kind,)
