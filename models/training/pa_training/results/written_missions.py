"""Writes the orders of writers as a mission set, each with what must be true of its run.

Success is worked out from the meaning alone, by the teacher (`teacher/success.py`). Left out are
meanings that come later (times), and dialogues from the first turn on whose meaning cannot be
scored.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import yaml

from pa_console.language.canonical.clauses import ASKED, NOTHING, OTHERS_STAY
from pa_console.language.canonical.order import Ask, Task
from pa_console.language.canonical.reading import read_asked
from pa_console.schema.evaluation import (
    Expectation,
    MissionCase,
    MissionSet,
    NamedWorld,
    WorldFile,
)
from pa_console.schema.world import World
from pa_console.sim.worlds.world_generator import world_yaml
from pa_training.orders.meaning import meaning_now, order_of, orders_nothing
from pa_training.orders.written import (
    Source,
    WrittenDialogue,
    WrittenOrder,
    WrittenSituation,
    drawn_situation,
    read_writers,
)
from pa_training.situations.situations import Situation
from pa_training.situations.worlds import generated_numbers, shipped_missions
from pa_training.teacher.success import STAYS, conditions
from pa_training.teacher.teacher import WATCH_S, teach

MOVED_NOBODY = ("size(run.moved) == 0",)
_STAY = re.compile(r" for \d+ (min|h|s)$")
_PLAIN: frozenset[Task] = frozenset(
    ("go", "look", "home", "hold", "report", "swap", "mass", "identify", "warn", "block")
)
"""The tasks whose outcome is known whatever was ordered before."""


class WorldCases(NamedTuple):
    """The missions in one world."""

    world: World
    cases: Sequence[MissionCase]


def write_written_missions(file: Path, source: Source) -> MissionSet:
    """Write what the writers of `source` ordered to `file`.

    Raises DocumentError for a broken file, ValueError for a `file` that is there already.
    """
    if file.exists():
        raise ValueError(f"{file}: is there already; name another file, or remove it")
    file.parent.mkdir(parents=True, exist_ok=True)
    name = "".join(letter if letter.isalnum() else "_" for letter in file.stem)
    return write_mission_set(file, name, "orders of writers", [*written_missions(source)])


def write_mission_set(
    file: Path, name: str, source: str, parts: Sequence[WorldCases]
) -> MissionSet:
    """Write missions to `file`, their worlds into the folder `<stem>-worlds` beside it.

    Equal worlds share a file. Raises OSError.
    """
    folder = file.with_name(f"{file.stem}-worlds")
    folder.mkdir(parents=True, exist_ok=True)
    worlds: dict[str, str] = {}
    cases: list[MissionCase] = []
    for part in parts:
        text = world_yaml(part.world)
        world = worlds.setdefault(text, f"w{len(worlds):03d}")
        for case in part.cases:
            cases.append(case.model_copy(update={"id": f"G{len(cases):03d}", "world": world}))
    for text, world in worlds.items():
        (folder / f"{world}.yaml").write_text(text, encoding="utf-8")
    files: dict[str, NamedWorld] = {
        world: WorldFile(file=f"{folder.name}/{world}.yaml") for world in worlds.values()
    }
    missions = MissionSet(name=name, source=source, worlds=files, missions=tuple(cases))
    file.write_text(_mission_set_yaml(missions), encoding="utf-8")
    return missions


def _mission_set_yaml(missions: MissionSet) -> str:
    """Return `missions` as the text of a file that reads back equal."""
    document = missions.model_dump(mode="json", exclude_defaults=True)
    for written, case in zip(document["missions"], missions.missions, strict=True):
        if case.setup:
            written["setup"] = [
                {"kind": incident.kind} | incident.model_dump(mode="json", exclude_defaults=True)
                for incident in case.setup
            ]
    return yaml.safe_dump(document, sort_keys=False, width=100, allow_unicode=True)


def written_missions(source: Source) -> Iterator[WorldCases]:
    """Yield what the writers of `source` ordered, situation by situation.

    Raises DocumentError for a broken file.
    """
    forbidden = generated_numbers(shipped_missions())
    for name, writer in read_writers(source).items():
        for number, written in enumerate(writer.situations, 1):
            if written.history:
                continue  # a mission set knows set-ups only
            situation = drawn_situation(written, forbidden)
            cases = [*_cases(f"{name}/{number}", written, situation)]
            yield WorldCases(situation.world, cases)


def _cases(category: str, written: WrittenSituation, situation: Situation) -> Iterator[MissionCase]:
    for order in written.orders:
        turns = order.turns if isinstance(order, WrittenDialogue) else (order,)
        for at, turn in enumerate(turns, 1):
            if _later(turn.meaning):
                break
            case = _case(category, turns[:at], situation)
            if case is not None:
                yield case


def _later(meaning: str) -> bool:
    """Return whether a meaning is carried out at a later moment, or without an end."""
    return meaning.startswith(("at ", "in ", "every ")) or " patrol " in meaning


def _case(category: str, turns: Sequence[WrittenOrder], situation: Situation) -> MissionCase | None:
    """Return the case of the last of some `turns`; None where it cannot be scored."""
    *before, last = turns
    sort = "none" if orders_nothing(last.meaning) else "dialogue" if before else "order"
    meaning = meaning_now(last.meaning)
    expect: Expectation = "either"
    if not before and sort == "none":
        success, watch_s = MOVED_NOBODY, WATCH_S
    elif not before and meaning:
        try:
            order = order_of(meaning, situation.world, situation.digest)
            target = teach(order, situation.world, situation.picture, situation.digest)
        except (ValueError, LookupError):
            return None
        success, watch_s = target.success, target.watch_s
        expect = "execute" if target.expect == "execute" else "either"
    else:
        made = _outcome([turn.meaning for turn in turns], situation.world)
        if made is None:
            return None
        success, watch_s, sort = made, WATCH_S, sort if before else "steps"
    case = situation.case("W", last.text, success, expect, f"{category}/{sort}", watch_s)
    return case.model_copy(update={"before": tuple(turn.text for turn in before)})


def _outcome(meanings: Sequence[str], world: World) -> tuple[str, ...] | None:
    """Return what must be true at the end of orders that follow each other, in steps or turns.

    None where a part of them is no plain clause.
    """
    done, taken_back = list[list[Ask]](), list[Ask]()
    for meaning in meanings:
        if orders_nothing(meaning):
            continue
        words = meaning
        if words == "undo" or words.startswith(("undo; ", "instead: ")):
            taken_back += done.pop() if done else []
            words = words.removeprefix("undo").removeprefix("; ").removeprefix("instead: ")
        if words:
            asks = [*_asks(words)]
            if not asks or not all(_is_plain(ask) for ask in asks):
                return None
            done.append(asks)
    latest = list[Ask]()
    for ask in (ask for asks in done for ask in asks):
        latest = [one for one in latest if not {*one.who.names} & {*ask.who.names}] + [ask]
    names = {name for ask in latest for name in (*ask.who.names, ask.leaving)}
    back = [name for ask in taken_back for name in ask.who.names if name not in names]
    wanted = [
        text
        for text in conditions(latest, world)
        if not text.startswith("run.moved.all") and text not in STAYS
    ]
    wanted += [f"run.final.assets['{n}'].at == run.start.assets['{n}'].post" for n in back]
    if not any(ask.task != "hold" for ask in latest) and not back:
        wanted += MOVED_NOBODY if not taken_back else ()
    return tuple(dict.fromkeys(wanted)) or None


def _asks(words: str) -> Iterator[Ask]:
    for step in words.split("; then "):
        clauses = "; ".join(
            _STAY.sub("", part) for part in step.split("; ") if part not in (NOTHING, OTHERS_STAY)
        )
        read = read_asked(f"{ASKED}{clauses}") if clauses else None
        yield from () if read is None else read.asks


def _is_plain(ask: Ask) -> bool:
    return ask.task in _PLAIN and ask.wrong is None
