"""`pa-console rules effect`: which decisions a changed rule set would turn, before it is live."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from pa_console.cli.export.source import ExportBar
from pa_console.cli.output import BAD_INPUT, FAILED, JsonOption, errors, out, print_json
from pa_console.cli.rules.session_logs import SessionEvents, find_logs
from pa_console.evaluation.changed_decisions import (
    FLIP_KINDS,
    ChangedDecision,
    Gap,
    SessionEffect,
    effect_on_session,
    rules_turned,
)
from pa_console.policy.rulebook import Rulebook, load_rules
from pa_console.resources import existing_data
from pa_console.schema.document import DocumentError
from pa_console.station.assembly import SessionSites


@dataclass
class Effects:
    """The results by log or mission; `unread` has the logs that could not be read, and why."""

    found: dict[str, SessionEffect] = field(default_factory=dict[str, SessionEffect])
    unread: dict[str, str] = field(default_factory=dict[str, str])
    notes: dict[str, str] = field(default_factory=dict[str, str])

    @property
    def flips(self) -> list[ChangedDecision]:
        """Every decision that turns."""
        return [flip for effect in self.found.values() for flip in effect.flips]

    @property
    def gaps(self) -> list[Gap]:
        """Every decision that cannot be made again."""
        return [gap for effect in self.found.values() for gap in effect.gaps]


def effect(
    rules: Annotated[str, typer.Argument(help="The changed rule file.")],
    logs: Annotated[
        list[Path] | None,
        typer.Argument(metavar="LOG...", help="Session logs, or folders of them."),
    ] = None,
    missions: Annotated[
        list[str] | None,
        typer.Option(help="A mission set: a file, or a name beside the world; repeatable."),
    ] = None,
    was: Annotated[
        str | None,
        typer.Option(
            "--was", help="The rules until now, when they are not installed as they were."
        ),
    ] = None,
    world: Annotated[
        list[str] | None,
        typer.Option(
            "--world", help="A world of the sessions, or of the missions, as a file; repeatable."
        ),
    ] = None,
    plans: Annotated[
        int, typer.Option(min=1, help="With --missions: orders that are tried for each mission.")
    ] = 24,
    seed: Annotated[int, typer.Option(min=0, help="With --missions: which orders those are.")] = 0,
    json: JsonOption = False,
) -> None:
    """Check every recorded plan again under RULES; list each decision that would turn.

    A plan is checked against the picture, the rehearsal and the telemetry of its time. Missions
    of a set have no recorded plans: single orders are tried there. Exit code 1 when a decision
    turns, 2 when something cannot be read.
    """
    if not logs and not missions:
        raise ValueError("give session logs, or a mission set with --missions")
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
                    "sessions": effects.found, "notes": effects.notes, "unread": effects.unread,
                    "turned": dict(rules_turned(effects.flips))})  # fmt: skip
    else:
        _print(effects)
    if effects.unread:
        raise typer.Exit(BAD_INPUT)
    if effects.flips:
        raise typer.Exit(FAILED)


def _sessions(logs: list[Path], new: Rulebook, sites: SessionSites, effects: Effects) -> None:
    with ExportBar("checking sessions again", len(logs)) as bar:
        for log in logs:
            try:
                events = SessionEvents(log)
                started = events.started
                rulebook = sites.rules_of(started)
                place = sites.world_of(started, log)
                effects.found[str(log)] = effect_on_session(events, place, new, rulebook)
                if rulebook is None:
                    effects.notes[str(log)] = (
                        f"its rules {started.rules!r} are not here as they were (give them with "
                        "--was): compared with what is recorded; what running plans broke is not"
                    )
                if events.problem:
                    effects.unread[str(log)] = events.problem
            except (DocumentError, ValueError) as error:
                effects.unread[str(log)] = str(error)
            bar.advance(1)


def _missions(
    name: str, new: Rulebook, was: str, world: str, tried: tuple[int, int], effects: Effects
) -> None:
    from pa_console.evaluation.changed_decisions import effect_on_mission  # noqa: PLC0415
    from pa_console.evaluation.runs.jobs import load_with_worlds, mission_file  # noqa: PLC0415
    from pa_console.sim.worlds.world_file import open_world  # noqa: PLC0415

    own, own_path = open_world(world)
    path = mission_file(name, own_path)
    cases, worlds = load_with_worlds(path, own)
    old = load_rules(existing_data("rules", was, "rules.yaml"))
    plans, seed = tried
    with ExportBar(f"trying orders at {cases.name}", len(cases.missions) * (plans + 1)) as bar:
        for case in cases.missions:
            effects.found[f"{path}:{case.id}"] = effect_on_mission(
                case, worlds[case.world], new, old, plans, seed, lambda: bar.advance(1)
            )


def _print(effects: Effects) -> None:
    """Print the changed and the undecidable results, by log; then the sums."""
    for place, found in effects.found.items():
        if not found.flips and not found.gaps and place not in effects.notes:
            continue
        _line(f"{place}: session {found.session}" if found.session else f"{place}:")
        if place in effects.notes:
            _line(f"  note: {effects.notes[place]}")
        for flip in found.flips:
            _line(_flip(flip))
        for gap in found.gaps:
            at = f"{gap.mission} attempt {gap.attempt}" if gap.attempt else gap.mission
            rule = f" {gap.rule}:" if gap.rule else ""
            _line(f"  {at}: cannot be checked again:{rule} {gap.reason}")
    for place, problem in effects.unread.items():
        errors.print(f"{place}: not read to its end: {problem}", markup=False, soft_wrap=True)
    for rule, count in rules_turned(effects.flips):
        _line(f"{rule} turns {count}")
    every = effects.found.values()
    kinds = [(kind, sum(f.kind == kind for f in effects.flips)) for kind in FLIP_KINDS]
    parts = ", ".join(f"{count} {kind}" for kind, count in kinds if count) or "none"
    _line(
        f"sessions {sum(bool(e.session) for e in every)}, missions "
        f"{sum(e.missions for e in every)}, plans {sum(e.plans for e in every)}, findings "
        f"{sum(e.compared for e in every)}; turned: {parts}; "
        f"cannot be checked again: {len(effects.gaps)}; not read: {len(effects.unread)}"
    )


def _flip(flip: ChangedDecision) -> str:
    at = f"{flip.mission} attempt {flip.attempt}" if flip.attempt else flip.mission
    plan = f" [{flip.plan}]" if flip.plan else ""
    rules = ", ".join(flip.rules)
    return f"  {at}{plan}: {flip.kind} {rules}: {flip.was} -> {flip.now}: {flip.words}"


def _line(text: str) -> None:
    out.print(text, markup=False, soft_wrap=True)
