"""`python -m tests.benchmarks`, which `make bench` runs."""

import typer

from pa_console.cli.main import run
from tests.benchmarks import live, load, scale, screen, shift, twins
from tests.benchmarks.degradation import degradation
from tests.benchmarks.judge import judge
from tests.benchmarks.retrieval import retrieval
from tests.benchmarks.speed import speed
from tests.benchmarks.start import start

NAME = "python -m tests.benchmarks"

app = typer.Typer(
    name=NAME,
    help="Measure the console on this machine; without a name, its parts against the plain way.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.callback(invoke_without_command=True)(speed.speed)
app.command("load")(load.load)
app.command("live")(live.live)
app.command("scale")(scale.scale)
app.command("retrieval")(retrieval.retrieval)
app.command("twins")(twins.twins)
app.command("degradation")(degradation.degradation)
app.command("judge")(judge.judge)
app.command("start")(start.start)
app.command("screen")(screen.screen)
app.command("shift")(shift.shift)

if __name__ == "__main__":
    run(app, NAME)
