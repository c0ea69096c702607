"""Tokenises sample files for one base, so that a machine without a tokeniser can learn them.

`python -m pa_training.gpu.prepare --model NAME --out FILE SAMPLES...`; samples are JSON
lines, gzipped or not. The branches of a pack are of like lengths, so that little is padded.
"""

import argparse
import random
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np

from pa_console.llm.models.catalogue import Catalog
from pa_training.gpu.corpus import Branch, Pack, write_corpus
from pa_training.lora.material import Tokeniser, make_packs
from pa_training.lora.packs import Pack as LoraPack
from pa_training.samples.sample import Sample, read_samples

MOST_TOKENS = 4096
TOGETHER = 40
"""Groups that a process tokenises at once."""
Group = list[Sample]


def main() -> None:
    """Prepare as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", required=True, help="a model of the catalogue")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--tasks", default="", help="only these, e.g. planner,judge")
    parser.add_argument("--kind", default="", help="only samples whose kind ends so: spoken")
    parser.add_argument("--drop", type=float, default=0.0, help="share of the groups left out")
    parser.add_argument("samples", type=Path, nargs="+")
    args = parser.parse_args()
    tasks = set(filter(None, args.tasks.split(",")))
    kept = [
        group
        for group in groups(args.samples, tasks, args.kind)
        if random.Random(f"drop/{group[0].group}").random() >= args.drop
    ]
    parts = [kept[start : start + TOGETHER] for start in range(0, len(kept), TOGETHER)]
    with ProcessPoolExecutor(args.processes) as pool:
        packs = [
            pack for some in pool.map(_packed, [args.model] * len(parts), parts) for pack in some
        ]
    size = write_corpus(args.out, packs)
    samples = sum(len(pack.branches) for pack in packs)
    tokens = sum(pack.size for pack in packs)
    answers = sum(len(branch.targets) for pack in packs for branch in pack.branches)
    print(
        f"{args.out}: {len(packs)} packs, {samples} samples, {tokens} tokens, "
        f"{answers} to be predicted, {size / 1e6:.1f} MB"
    )


def groups(files: Sequence[Path], tasks: set[str], kind: str = "") -> Iterator[Group]:
    """Yield the samples of `files` that share a prompt's beginning, shortest first.

    Only of these `tasks`, where there are any, and of kinds that end with `kind`.
    """
    for file in files:
        found: dict[tuple[str, str, str], Group] = {}
        for sample in read_samples(file):
            if (not tasks or sample.task in tasks) and sample.kind.endswith(kind):
                key = sample.group, sample.system, sample.picture
                found.setdefault(key, []).append(sample)
        for group in found.values():
            yield sorted(group, key=lambda sample: len(sample.rest) + len(sample.answer))


def _packed(model: str, some: Iterable[Group]) -> list[Pack]:
    tokeniser = _tokeniser(model)
    return [pack for group in some for pack in _packs(tokeniser, group)]


def _packs(tokeniser: Tokeniser, group: Group) -> Iterator[Pack]:
    """Yield the packs of samples that share system and picture, filled in order.

    A prompt is read in two pieces, up to the end of the picture and from there, where that gives
    the tokens of the whole (checked with the longest sample); else each is read as a whole.
    """
    start, end = tokeniser.around(group[0].system, group[0].picture)
    last = group[-1]
    if [*start, *tokeniser.text(last.rest), *end] != tokeniser.prompt(last):
        yield from (_of(pack) for pack in make_packs(group, tokeniser, MOST_TOKENS))
        return
    together: list[Branch] = []
    size = len(start)
    for sample in group:
        answer = tokeniser.answer(sample)
        tokens = [*tokeniser.text(sample.rest), *end, *answer[:-1]]
        learnt = tokeniser.weights(sample) > 0 if sample.given else np.ones(len(answer), np.bool_)
        branch = Branch(np.array(tokens, np.int32), np.array(answer, np.int32), learnt)
        if together and size + len(tokens) > MOST_TOKENS:
            yield Pack(np.array(start, np.int32), tuple(together))
            together, size = [], len(start)
        together.append(branch)
        size += len(tokens)
    yield Pack(np.array(start, np.int32), tuple(together))


def _of(pack: LoraPack) -> Pack:
    branches = (Branch(b.tokens, b.targets, b.weights > 0) for b in pack.branches)
    return Pack(pack.prefix, tuple(branches))


@cache
def _tokeniser(model: str) -> Tokeniser:
    entry = Catalog.load().get(model)
    path = entry.local_file
    if path is None:
        raise ValueError(f"{model} is not on this machine: run pa-console models pull {model}")
    return Tokeniser(entry.learnt_file(path), entry.chat)


if __name__ == "__main__":
    main()
