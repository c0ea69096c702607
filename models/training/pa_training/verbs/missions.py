"""The verb `missions`: generated missions in generated worlds, to evaluate with."""

from collections import Counter
from contextlib import closing
from pathlib import Path

from rich.table import Table

from pa_console.resources import find_data
from pa_console.schema.text import count as counted
from pa_console.terminal.output import errors, out, print_json
from pa_training.results.mission_export import Found, generated_missions, write_mission_set
from pa_training.samples.data_report import fingerprint
from pa_training.situations.worlds import Split
from pa_training.verbs.progress import MissionProgress


def make_missions(
    file: Path, count: int, seed: int, split: Split, rules: str, processes: int, json: bool
) -> None:
    """Write `count` missions to `file` and print how many of each category there are.

    Raises DocumentError for a broken rule file, ValueError for a file that is there already.
    """
    if file.exists():
        raise ValueError(f"{file}: is there already; name another file, or remove it")
    rules_file = find_data("rules", rules, "rules.yaml")
    file.parent.mkdir(parents=True, exist_ok=True)
    found: list[Found] = []
    worlds = generated_missions(count, seed, split, rules_file, processes)
    with MissionProgress(count) as progress, closing(worlds):
        for part in worlds:
            found.append(part)
            progress.add(len(part.cases))
    source = (
        f"generated: {split} names and worlds, seed {seed}, generator {fingerprint(rules_file)}; "
        "every mission has a plan that was proven right"
    )
    name = "".join(letter if letter.isalnum() else "_" for letter in file.stem)
    missions = write_mission_set(file, name, source, found)
    categories = Counter(case.category for case in missions.missions)
    if json:
        print_json({"file": str(file), "worlds": len(missions.worlds), "categories": categories})
        return
    table = Table("category", "missions")
    for category, number in categories.most_common():
        table.add_row(category, str(number))
    out.print(table)
    dropped = sum(part.dropped for part in found)
    errors.print(
        f"{counted(len(missions.worlds), 'world')}; not taken: {counted(dropped, 'mission')}"
    )
    out.print_line(str(file))
