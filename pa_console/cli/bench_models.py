"""Runs and prints the model bench with progress, keeping a session log of every run."""

from pathlib import Path

from rich.table import Table

from pa_console.cli.output import errors, out, print_json
from pa_console.evaluation.mission_set import load_missions
from pa_console.evaluation.model_bench import BenchRow, BenchTotal, bench_model, total
from pa_console.llm.catalog import find_model
from pa_console.llm.engine import Engine
from pa_console.orchestrator.compose import load_site
from pa_console.orchestrator.headless import Sink
from pa_console.resources import data_folder
from pa_console.schema.event import Event
from pa_console.schema.mission_set import MissionCase
from pa_console.session.fold import SessionState
from pa_console.session.log import LogWriter, new_log_path

LEGEND = """\
JSON: the first answer is a plan. 1st: it breaks no Critical or High rule. rep: some attempt breaks
none. judge: the verdict on the plan shown. exec: executed without overruling anything. veri:
telemetry shows that it happened. sec: from intake to verdict."""


async def run_bench(
    names: list[str],
    missions: Path | None,
    site_names: tuple[str, str],
    seed: int,
    logs: Path | None,
    json: bool,
) -> None:
    """Bench each model of `names` in turn; raises DocumentError or ModelError before any run."""
    site = load_site(*site_names)
    path = missions or data_folder() / "worlds" / "checkpoint" / "missions" / "paper.yaml"
    mission_set = load_missions(path, site.world)
    engines = {name: Engine(find_model(name)) for name in names}
    rows: dict[str, list[BenchRow]] = {name: [] for name in names}
    with errors.status("starting") as status:
        for name, engine in engines.items():

            def sink_for(case: MissionCase, session: str, name: str = name) -> Sink:
                status.update(f"{name}: {case.id} {case.command}")
                return _logging(logs, f"{Path(name).stem}-{case.id}", session)

            async for row in bench_model(site, engine, mission_set, sink_for, seed):
                rows[name].append(row)
            await engine.close()
    totals = [total(name, found) for name, found in rows.items()]
    if json:
        print_json({"totals": totals, "rows": rows})
        return
    for name, found in rows.items():
        _print_rows(name, found)
    out.print(_totals_table(totals))
    out.print(LEGEND)


def _logging(folder: Path | None, stem: str, session: str) -> Sink:
    """Return a sink that writes a run's log into `folder`, or one that keeps nothing."""
    if folder is None:
        return lambda _event, _state: None
    writer = LogWriter(new_log_path(folder, f"{stem}-{session}"), session)

    def write(event: Event, _state: SessionState) -> None:
        writer.append(event)
        if event.data.kind == "session_ended":
            writer.close()

    return write


def _print_rows(name: str, rows: list[BenchRow]) -> None:
    """Print one line of figures a mission, then what was planned and what stood in the way."""
    table = Table(
        "id", "JSON", "1st", "rep", "try", "judge", "exec", "veri", "sec", "status", title=name
    )  # fmt: skip
    for row in rows:
        flags = (row.valid_json, row.first_attempt, row.after_repair)
        done = (row.executed, row.verified)
        table.add_row(
            row.mission,
            *map(_mark, flags),
            str(row.attempts),
            row.judge,
            *map(_mark, done),
            f"{row.decision_s:.1f}",
            row.status,
        )
    out.print(table)
    for row in rows:
        why = "" if row.verified else f" ({row.reason})"
        out.print(f"{row.mission}: {row.plan or 'no plan'}{why}", markup=False, soft_wrap=True)


def _totals_table(totals: list[BenchTotal]) -> Table:
    table = Table(
        "model", "of", "JSON", "1st", "rep", "judge ok", "exec", "veri", "median s", "longest s"
    )  # fmt: skip
    for entry in totals:
        table.add_row(
            entry.model,
            str(entry.missions),
            str(entry.valid_json),
            str(entry.first_attempt),
            str(entry.after_repair),
            str(entry.judged_success),
            str(entry.executed),
            str(entry.verified),
            f"{entry.median_decision_s:.1f}",
            f"{entry.longest_decision_s:.1f}",
        )
    return table


def _mark(value: bool) -> str:
    return "yes" if value else "no"
