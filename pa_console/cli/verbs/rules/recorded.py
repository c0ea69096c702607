"""`pa-console rules effect` and `rules trace`: rules in recorded sessions."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli.options import JsonOption
from pa_console.cli.progress_bars import TransientBar
from pa_console.evaluation.changed_decisions import (
    FLIP_KINDS,
    ChangedDecision,
    Gap,
    SessionEffect,
    rules_turned,
)
from pa_console.evaluation.recorded_decisions import effect_on_session
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import existing_data
from pa_console.schema.document import DocumentError
from pa_console.schema.events.event import Event
from pa_console.session.log.chain import LogError, read_log, session_start
from pa_console.station.assembly import SessionSites
from pa_console.terminal.output import BAD_INPUT, FAILED, errors, out, print_json
from pa_console.views.rule_trail import BREAKING, RuleDeed, Trail, trail_of

COUNTED_DEEDS: tuple[tuple[str, tuple[RuleDeed, ...]], ...] = (
    ("retrieved", ("retrieved",)),
    ("decided", ("decided", "broken", "refused")),
    ("broken", BREAKING),
    ("prescribed", ("prescribed",)),
)

LOGS = typer.Argument(metavar="LOG...", help="Session logs, or folders with session logs.")


def find_logs(places: Sequence[Path]) -> list[Path]:
    """Return every session log in `places`, which are logs or folders.

    Other files in a folder are ignored. Raises ValueError if a place does not exist, or if a folder
    has no log.
    """
    files: list[Path] = []
    for place in places:
        if place.is_dir():
            logs = [path for path in sorted(place.rglob("*.jsonl")) if _is_log(path)]
            if not logs:
                raise ValueError(f"{place}: there is no session log in this folder")
            files += logs
        elif place.is_file():
            files.append(place)
        else:
            raise ValueError(f"{place}: there is no such log or folder")
    return list(dict.fromkeys(files))


class SessionEvents:
    """The events of a log, for one iteration; `problem` is why they ended early, or ''."""

    def __init__(self, log: Path) -> None:
        """Read the start of the session; raises LogError if the file is not a session log."""
        self.started = session_start(next(read_log(log), None), log)
        self._log = log
        self.problem = ""

    def __iter__(self) -> Iterator[Event]:
        try:
            yield from read_log(self._log)
        except LogError as error:
            self.problem = str(error)


def _is_log(path: Path) -> bool:
    with path.open("rb") as file:
        return b'"kind":"session_started"' in file.readline(1 << 20).replace(b'": "', b'":"')


@dataclass
class Effects:
    """The effects of a change, by log or mission; `unread` has the reason for each unread log."""

    by_place: dict[str, SessionEffect] = field(default_factory=dict[str, SessionEffect])
    unread: dict[str, str] = field(default_factory=dict[str, str])
    notes: dict[str, str] = field(default_factory=dict[str, str])

    @property
    def flips(self) -> list[ChangedDecision]:
        """All decisions that change."""
        return [flip for effect in self.by_place.values() for flip in effect.flips]

    @property
    def gaps(self) -> list[Gap]:
        """All decisions that cannot be repeated."""
        return [gap for effect in self.by_place.values() for gap in effect.gaps]


def effect(
    rules: Annotated[str, typer.Argument(help="Changed rule file.")],
    logs: Annotated[list[Path] | None, LOGS] = None,
    missions: Annotated[
        list[str] | None,
        typer.Option(help="Mission set: a file, or the name of a set of the world. Repeatable."),
    ] = None,
    was: Annotated[
        str | None,
        typer.Option("--was", help="Previous rules, if they are not installed or have changed."),
    ] = None,
    world: Annotated[
        list[str] | None,
        typer.Option("--world", help="World file of the sessions or the missions. Repeatable."),
    ] = None,
    plans: Annotated[
        int, typer.Option(min=1, help="With --missions: number of random orders per mission.")
    ] = 24,
    seed: Annotated[
        int, typer.Option(min=0, help="With --missions: seed of the random orders.")
    ] = 0,
    json: JsonOption = False,
) -> None:
    """Check recorded plans again with the changed RULES, and list the decisions that change.

    A plan is checked against the recorded picture, rehearsal and telemetry. Missions of a set have
    no recorded plans, so random single orders are checked instead. Exits with 1 if a decision
    changes, and with 2 if a log cannot be read.
    """
    if not logs and not missions:
        raise ValueError("give session logs, or a mission set with --missions NAME")
    new = load_rules(existing_data("rules", rules, "rules.yaml"))
    effects = Effects()
    if logs:
        _sessions(find_logs(logs), new, SessionSites(world or (), (was,) if was else ()), effects)
    for name in missions or ():
        _missions(
            name, new, was or "checkpoint", (world or ["checkpoint"])[0], (plans, seed), effects
        )
    if json:
        print_json({"rules": new.name, "content_sha256": new.seal.content_sha256,
                    "sessions": effects.by_place, "notes": effects.notes, "unread": effects.unread,
                    "turned": dict(rules_turned(effects.flips))})  # fmt: skip
    else:
        _print_effects(effects)
    if effects.unread:
        raise typer.Exit(BAD_INPUT)
    if effects.flips:
        raise typer.Exit(FAILED)


def _sessions(logs: list[Path], new: Rulebook, sites: SessionSites, effects: Effects) -> None:
    with TransientBar("checking sessions", len(logs)) as bar:
        for log in logs:
            try:
                events = SessionEvents(log)
                started = events.started
                rulebook = sites.rules_of(started)
                place = sites.world_of(started, log)
                effects.by_place[str(log)] = effect_on_session(events, place, new, rulebook)
                if rulebook is None:
                    effects.notes[str(log)] = (
                        f"its rules {started.rules!r} are not installed, or they have changed "
                        "(give them with --was), so only the recorded findings were compared, "
                        "without those on running plans"
                    )
                if events.problem:
                    effects.unread[str(log)] = events.problem
            except (DocumentError, ValueError) as error:
                effects.unread[str(log)] = str(error)
            bar.advance()


def _missions(
    name: str, new: Rulebook, was: str, world: str, tried: tuple[int, int], effects: Effects
) -> None:
    from pa_console.evaluation.changed_decisions import effect_on_mission  # noqa: PLC0415
    from pa_console.evaluation.jobs import load_with_worlds, mission_file  # noqa: PLC0415
    from pa_console.sim.worlds.world_file import open_world  # noqa: PLC0415

    own, own_path = open_world(world)
    path = mission_file(name, own_path)
    cases, worlds = load_with_worlds(path, own)
    old = load_rules(existing_data("rules", was, "rules.yaml"))
    plans, seed = tried
    with TransientBar(
        f"checking orders for {cases.name}", len(cases.missions) * (plans + 1)
    ) as bar:
        for case in cases.missions:
            effects.by_place[f"{path}:{case.id}"] = effect_on_mission(
                case, worlds[case.world], new, old, plans, seed, bar.advance
            )


def _print_effects(effects: Effects) -> None:
    """Print the changed decisions and the gaps by log, then the totals."""
    for place, outcome in effects.by_place.items():
        if not outcome.flips and not outcome.gaps and place not in effects.notes:
            continue
        out.print_line(f"{place}: session {outcome.session}" if outcome.session else f"{place}:")
        if place in effects.notes:
            out.print_line(f"  note: {effects.notes[place]}")
        for flip in outcome.flips:
            out.print_line(_flip(flip))
        for gap in outcome.gaps:
            at = f"{gap.mission} attempt {gap.attempt}" if gap.attempt else gap.mission
            rule = f" {gap.rule}:" if gap.rule else ""
            out.print_line(f"  {at}: cannot be checked again:{rule} {gap.reason}")
    for place, problem in effects.unread.items():
        errors.print_line(f"{place}: not read completely: {problem}")
    for rule, count in rules_turned(effects.flips):
        out.print_line(f"{rule} changes {count}")
    every = effects.by_place.values()
    kinds = [(kind, sum(f.kind == kind for f in effects.flips)) for kind in FLIP_KINDS]
    parts = ", ".join(f"{count} {kind}" for kind, count in kinds if count) or "none"
    out.print_line(
        f"sessions {sum(bool(e.session) for e in every)}, missions "
        f"{sum(e.missions for e in every)}, plans {sum(e.plans for e in every)}, findings "
        f"{sum(e.compared for e in every)}; changed: {parts}; "
        f"cannot be checked again: {len(effects.gaps)}; not read: {len(effects.unread)}"
    )


def _flip(flip: ChangedDecision) -> str:
    at = f"{flip.mission} attempt {flip.attempt}" if flip.attempt else flip.mission
    plan = f" [{flip.plan}]" if flip.plan else ""
    rules = ", ".join(flip.rules)
    return f"  {at}{plan}: {flip.kind} {rules}: {flip.was} -> {flip.now}: {flip.words}"


def trace(
    rule: Annotated[str, typer.Argument(metavar="RULE_ID", help="Id of a rule, such as ROE-07.")],
    logs: Annotated[list[Path], LOGS],
    every: Annotated[
        bool, typer.Option("--all", help="Also show where it does not apply.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """List every mission in which a rule was retrieved, decided a plan, or was broken.

    Each line shows the event, the simulation's tick, the attempt and the finding. Exits with 1 if
    no session mentions the rule, and with 2 if a log cannot be read.
    """
    trails: dict[str, list[Trail]] = {}
    unread: dict[str, str] = {}
    places = find_logs(logs)
    with TransientBar("reading sessions", len(places)) as bar:
        for log in places:
            try:
                events = SessionEvents(log)
                trails[str(log)] = trail_of(rule, events)
                if events.problem:
                    unread[str(log)] = events.problem
            except DocumentError as error:
                unread[str(log)] = str(error)
            bar.advance()
    if json:
        print_json({"rule": rule, "sessions": trails, "unread": unread})
    else:
        _print_trails(rule, trails, every)
    for log, problem in unread.items():
        errors.print_line(f"{log}: not read completely: {problem}")
    if unread:
        raise typer.Exit(BAD_INPUT)
    if not any(trails.values()):
        raise typer.Exit(FAILED)


def _print_trails(rule: str, sessions: dict[str, list[Trail]], every: bool) -> None:
    for log, trails in sessions.items():
        for trail in trails:
            shown = [e for e in trail.entries if every or e.did != "not applicable"]
            if not shown:
                continue
            out.print_line(f"{log}: {trail.session} {trail.mission.id}  {trail.mission.text}")
            for entry in shown:
                attempt = f" attempt {entry.attempt}" if entry.attempt else ""
                words = f": {entry.words}" if entry.words else ""
                out.print_line(
                    f"  event {entry.event}, tick {entry.tick}{attempt}: {entry.did}{words}"
                )
    every_trail = [trail for trails in sessions.values() for trail in trails]
    parts = [f"{name} in {_count(every_trail, deeds)}" for name, deeds in COUNTED_DEEDS]
    searched = f"sessions searched: {len(sessions)}"
    if every_trail:
        out.print_line(f"{rule}, missions: {', '.join(parts)}; {searched}")
    else:
        out.print_line(f"{rule}: not mentioned in any mission; {searched}")


def _count(trails: Iterable[Trail], deeds: tuple[RuleDeed, ...]) -> int:
    return sum(trail.did(*deeds) for trail in trails)
