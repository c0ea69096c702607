"""Which runs of an evaluation are shown: by what went wrong and by words; and their rates."""

from collections.abc import Callable, Iterable, Sequence
from typing import Literal, NamedTuple, get_args

from pa_console.evaluation.record import RunRecord
from pa_console.evaluation.reporting.statistics import Rate

Kind = Literal["all", "strict", "judge", "rules", "refuse"]
"""A kind of runs; all but the first and the last are failures."""

KINDS: tuple[Kind, ...] = get_args(Kind)

LABELS: dict[Kind, str] = {
    "all": "all runs",
    "strict": "strict failures",
    "judge": "judge wrong",
    "rules": "rules broken",
    "refuse": "must be refused",
}


def judge_wrong(record: RunRecord) -> bool:
    """Whether a verdict of the judge, before or after, contradicts the strict success."""
    given = (record.judge_plan, record.judge_outcome)
    return any(verdict is not None and (verdict == "Success") != record.strict for verdict in given)


_TESTS: dict[Kind, Callable[[RunRecord], bool]] = {
    "all": lambda _: True,
    "strict": lambda record: not record.strict,
    "judge": judge_wrong,
    "rules": lambda record: bool(record.broken),
    "refuse": lambda record: record.expect == "refuse",
}


class RunFilter(NamedTuple):
    """A kind of runs, and words of which each has to be found in what is known of a run."""

    kind: Kind = "all"
    text: str = ""

    def passed(self, records: Iterable[RunRecord]) -> list[RunRecord]:
        """Return the records that pass, in the order in which they are given."""
        words, fits = self.text.lower().split(), _TESTS[self.kind]
        return [record for record in records if fits(record) and (not words or _has(record, words))]


def _has(record: RunRecord, words: Sequence[str]) -> bool:
    known = " ".join(
        (record.run, record.mission, record.model, record.variant, record.category, record.world,
         record.status, *record.tags, *(breach.rule_id for breach in record.broken),
         record.command)
    ).lower()  # fmt: skip
    return all(word in known for word in words)


class Totals(NamedTuple):
    """How many runs are shown of how many, and the rates of those that are shown."""

    shown: int
    runs: int
    strict: Rate
    hybrid: Rate

    @classmethod
    def of(cls, shown: Sequence[RunRecord], runs: int) -> "Totals":
        """Count the records that are shown."""
        strict = Rate.of(record.strict for record in shown)
        hybrid = Rate.of(record.hybrid for record in shown if record.hybrid is not None)
        return cls(len(shown), runs, strict, hybrid)
