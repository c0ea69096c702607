"""Writes the orders of writers as a mission set, each with what must be true of its run.

    python -m pa_training.results.written_missions FOLDER --out FILE

The set can be run with `pa-console eval --missions FILE --variant one-plan`. Success is worked out
from the meaning alone, by the teacher (`teacher/success.py`). Left out are meanings that come later
(times), and dialogues from the first turn on whose meaning cannot be scored.
"""

import argparse
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from pa_console.language.canonical.clauses import ASKED, OTHERS_STAY
from pa_console.language.canonical.order import Ask, Task
from pa_console.language.canonical.reading import read_asked
from pa_console.schema.evaluation import Expectation, MissionCase
from pa_console.schema.world import World
from pa_training.order_generator.orders import Order
from pa_training.results.mission_export import Found, write_mission_set
from pa_training.samples.written_orders import (
    WrittenDialogue,
    WrittenOrder,
    WrittenSituation,
    drawn_situation,
    meaning_now,
    ordered,
    orders_nothing,
    read_writers,
)
from pa_training.situations.situations import Situation
from pa_training.situations.worlds import generated_numbers, shipped_missions
from pa_training.teacher.success import NOTHING, conditions
from pa_training.teacher.teacher import WATCH_S

MOVED_NOBODY = ("size(run.moved) == 0",)


def written_missions(folder: Path) -> Iterator[Found]:
    """Yield what the writers of `folder` ordered, situation by situation.

    Raises DocumentError for a broken file.
    """
    forbidden = generated_numbers(shipped_missions())
    for name, writer in read_writers(folder).items():
        for number, written in enumerate(writer.situations, 1):
            if written.history:
                continue  # a mission set knows set-ups only
            situation = drawn_situation(written, forbidden)
            yield Found(situation.world, [*_cases(f"{name}/{number}", written, situation)])


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
            target = ordered(meaning, situation)
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
        for text in conditions(latest, Order(tuple(latest)), world)
        if not text.startswith("run.moved.all") and text not in NOTHING
    ]
    wanted += [f"run.final.assets['{n}'].at == run.start.assets['{n}'].post" for n in back]
    if not any(ask.task != "hold" for ask in latest) and not back:
        wanted += MOVED_NOBODY if not taken_back else ()
    return tuple(dict.fromkeys(wanted)) or None


def _asks(words: str) -> Iterator[Ask]:
    for step in words.split("; then "):
        clauses = "; ".join(
            _STAY.sub("", part) for part in step.split("; ") if part not in ("nothing", OTHERS_STAY)
        )
        read = read_asked(f"{ASKED}{clauses}") if clauses else None
        yield from () if read is None else read.asks


_STAY = re.compile(r" for \d+ (min|h|s)$")
_PLAIN: frozenset[Task] = frozenset(
    ("go", "look", "home", "hold", "report", "swap", "mass", "identify", "warn", "block")
)


def _is_plain(ask: Ask) -> bool:
    return ask.task in _PLAIN and ask.wrong is None


def main() -> None:
    """Write the mission set."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="the writers' files")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    made = write_mission_set(
        given.out, given.folder.name, "orders of writers", [*written_missions(given.folder)]
    )
    print(f"{len(made.missions)} missions in {given.out}")


if __name__ == "__main__":
    main()
