"""Prompts, grammars and canonical texts of seventy missions.

The prompts of four named missions are kept whole in `prompts/`, to be read. All texts, grammars
too, are pinned by one fingerprint for each kind in `prompts.json`. What holds in every mission is
asserted of every mission: the sections and their order, what a prompt begins with, which plans a
grammar allows.
"""

import re
from collections.abc import Iterator
from functools import cache

import pytest

from pa_console.llm.roles.role_model import PROMPT_FORMATS
from tests.golden.prompt_cases import LARGE, PAPER, REPAIR, Case, cases, everything
from tests.golden.prompt_files import NAMED, fingerprints, readable
from tests.golden.stored import HERE, compare, read, write, write_text
from tests.llm.test_grammar import accepts

# Seventy missions are planned, and a busy machine takes minutes for them.
pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]

LOOK = (
    "See a text as it is now with: python -m tests.golden.record show MISSION NAME\n"
    "(and as it was with the same at the commit that last changed prompts.json)"
)
RULE = r"[A-Z]+-\d+: .+"
MISSION = r'Mission: "(?:[^"\\]|\\.)*"'
Sections = tuple[tuple[str, str, bool], ...]
"""The sections of a prompt in order: name, pattern of each of its lines, required or not."""


def record() -> None:
    """Write the files and fingerprints as they are now."""
    write("prompts.json", fingerprints(texts()))
    for name, text in readable(texts()).items():
        write_text(f"prompts/{name}.txt", text)


def show(mission: str, name: str = "") -> str:
    """Return one text for a mission as it is now; without a `name`, all names."""
    case = next(case for case in cases() if case.name == mission)
    found = everything(case)
    return found[name] if name else "\n".join(found)


@cache
def texts() -> dict[str, dict[str, str]]:
    """Return every text of every mission."""
    return {case.name: everything(case) for case in cases()}


def prompts(name: str) -> Iterator[tuple[Case, str]]:
    """Yield each mission with its text `name`."""
    for case in cases():
        yield case, texts()[case.name][name]


@pytest.mark.parametrize("file", NAMED.values())
def test_the_prompts_of_a_named_mission_are_as_reviewed(file: str) -> None:
    stored = (HERE / f"prompts/{file}.txt").read_text(encoding="utf-8").splitlines()
    now = readable(texts())[file].splitlines()
    compare("prompts", {file: stored}, {file: now}, f"Stored in tests/golden/prompts/{file}.txt.")


def test_no_kind_of_text_has_changed_in_any_mission() -> None:
    compare("prompts", read("prompts.json"), fingerprints(texts()), LOOK)


def compact(case: Case) -> Sections:
    """Return the sections of a compact prompt about the world of `case`."""
    world, picture = case.situation.world, case.situation.picture
    return (
        ("places", rf"(?:{'|'.join(world.frames)}): .+", True),
        ("tracks at gates", rf"At (?:{'|'.join(world.gates)}): .+", True),
        ("assets", rf"(?:{'|'.join(picture.assets)}): .+", True),
        ("free assets", r"Free (?:drone|vehicle|robot): .+", False),
        ("unknown", r"Unknown: .+", False),
        ("tracks", rf"(?:{'|'.join(picture.tracks) or '-'}): .+", False),
        ("rules", RULE, False),
        ("mission", MISSION, True),
    )


def examples(_case: Case) -> Sections:
    """Return the sections of a prompt for an untrained model."""
    return (
        ("heading", "Rules", True),
        ("rules", RULE, True),
        ("situation", r"(?:Frames|Down|Low battery|Unknown|Tracks): .+", False),
        ("without guard", r"Without guard: .+", False),
        ("guards", r"Guards: .+", False),
        ("mission", MISSION, True),
        ("free assets", r"Free: .+", True),
    )


def clauses(_case: Case) -> Sections:
    """Return the sections of a prompt that asks for clauses by taught orders."""
    return (
        ("names", r"(?:Gates|Places|Drones|Vehicles|Robots|Vehicle|Person): .+", True),
        ("taught orders", "Orders elsewhere", True),
        ("each with its clauses", rf"{MISSION}|\{{\"reason\": \"asked: .+\"\}}", True),
        ("the order", "The order to read", True),
        ("mission", MISSION, True),
    )


def paper(_case: Case) -> Sections:
    """Return the sections of the prompt of the paper."""
    return (
        ("mission", "Mission Command: .+", True),
        ("instruction", "|Instruction: Return only valid JSON; .+", True),
        ("commands", "Commands", True),
        ("each command", r"[a-z_]+(?: FRAME)?: .+", True),
        ("frames", "Frames: .+", False),
        ("state", "|Current State:", True),
        ("each asset", r"\w+: .+", True),
        ("context", "|Retrieved Context:", True),
        ("rules", RULE, True),
        ("format", "|Expected Output Format:", True),
        ("shape", r"\{\"actions\": .+\}", True),
    )


SHAPES = {"compact": compact, "examples": examples, "clauses": clauses, "paper": paper}


def found_sections(prompt: str, sections: Sections, where: str) -> list[str]:
    """Return the names of the sections in a prompt; fails at a line that none allows there."""
    place, found = 0, dict[str, None]()
    for line in prompt.split("\n"):
        fitting = (
            n for n in range(place, len(sections)) if re.fullmatch(sections[n][1], line, re.DOTALL)
        )
        place = next(fitting, -1)
        assert place >= 0, f"{where}: no section after {list(found)} has the line {line!r}"
        found[sections[place][0]] = None
    return list(found)


@pytest.mark.parametrize("name", SHAPES)
def test_every_planner_prompt_has_its_sections_in_order(name: str) -> None:
    for case, prompt in prompts(f"planner {name} user"):
        sections = SHAPES[name](case)
        found = found_sections(prompt, sections, case.name)
        missing = [part for part, _, required in sections if required and part not in found]
        assert not missing, case.name


@pytest.mark.parametrize("name", PROMPT_FORMATS)
def test_a_repair_adds_the_answer_and_each_objection_on_a_line(name: str) -> None:
    for case, again in prompts(f"planner {name} repair user"):
        mine = texts()[case.name]
        assert mine[f"planner {name} repair system"] == mine[f"planner {name} system"]
        assert again.startswith(mine[f"planner {name} user"])
        added = again.removeprefix(mine[f"planner {name} user"])
        assert added.count(case.plan.answer) == 1
        assert all(f"{objection.replace(chr(10), ' ')}" in added for objection in REPAIR)


@pytest.mark.parametrize("name", PROMPT_FORMATS)
def test_a_prompt_begins_with_all_that_is_read_ahead(name: str) -> None:
    for case in cases():
        mine = texts()[case.name]
        for role, asked in (("planner", f"planner {name}"), ("outcome", f"outcome {name} pass")):
            assert mine[f"ahead {name} {role} system"] == mine[f"{asked} system"], case.name
            assert mine[f"{asked} user"].startswith(mine[f"ahead {name} {role} user"]), case.name
            assert mine[f"ahead {name} {role} blind user"] == "", case.name


def test_a_prompt_read_while_the_order_is_typed_begins_the_prompt_with_its_words() -> None:
    for case, typed in prompts("typed compact planner user"):
        ahead = texts()[case.name]["ahead compact planner user"]
        begun, _, words = typed.rpartition('\nMission: "')
        assert begun.startswith(ahead.rstrip("\n")), case.name
        assert words, case.name


@pytest.mark.parametrize("name", PROMPT_FORMATS)
def test_the_grammar_of_a_known_order_allows_its_plan_for_the_assets_it_lists(name: str) -> None:
    for case, grammar in prompts(f"grammar {name} plan known"):
        # An answer in clauses states the order alone; the others add the facts that matter.
        reason = case.asked if name == "clauses" else case.plan.reason
        answer = case.plan.model_copy(update={"reason": reason}).answer
        # Of a large world a prompt and its grammar list a selection of the assets.
        listed = all(f'"{action.agent}\\"' in grammar for action in case.plan.actions)
        assert listed or int(case.name[1:]) in LARGE, case.name
        assert accepts(grammar, answer) == listed, case.name
        if case.plan.actions:
            stranger = answer.replace(f'"{case.plan.actions[0].agent}"', '"Drone_T99"')
            assert not accepts(grammar, stranger), case.name


@pytest.mark.parametrize("name", PROMPT_FORMATS)
def test_a_station_asks_for_a_plan_then_for_verdicts_and_ends_in_words(name: str) -> None:
    for case in cases():
        mine = texts()[case.name]
        if f"station {name} ended" not in mine:
            continue
        asked = [
            key.split()[3] for key in mine if re.fullmatch(rf"station {name} \d+ \w+ user", key)
        ]
        assert asked[0] == "planner", case.name
        assert set(asked) >= {"planner", "judge"}, case.name
        assert ("outcome" in asked) == (case.name in PAPER), case.name
        for number, role in enumerate(asked, start=1):
            request = f"station {name} {number} {role}"
            assert mine[f"{request} grammar"].startswith("start: "), request
            assert mine[f"{request} rest"].startswith(f"('{role}', "), request
        ended = mine[f"station {name} ended"]
        wanted = r"(un)?verified: .+" if case.name in PAPER else "rejected: .+"
        assert re.fullmatch(wanted, ended), case.name
