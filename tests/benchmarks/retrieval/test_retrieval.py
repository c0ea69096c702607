"""The benchmark `retrieval`: what it prints and refuses."""

from pathlib import Path

from tests.benchmarks.conftest import Measure


def test_the_tables_fit_eighty_columns_and_show_each_method_for_each_split(bench: Measure) -> None:
    done = bench("retrieval", "--size", "30", "--method", "paper", "--method", "related")
    assert done.code == 0
    assert done.out.count(" paper ") == done.out.count(" related ") == 4
    assert max(map(len, done.out.splitlines())) <= 80
    assert "…" not in done.out


def test_the_default_method_is_better_than_the_paper_s_on_every_split(bench: Measure) -> None:
    words = ("retrieval", "--size", "30", "--method", "paper", "--method", "related")
    paper, related = bench(*words).figures
    for one, other in zip(paper["quality"], related["quality"], strict=True):
        if not one["style"]:
            for measure in ("recall_3", "recall_10", "mrr", "ndcg_10"):
                assert other[measure]["mean"] > one[measure]["mean"]


def test_an_unknown_method_and_a_wrong_file_are_refused_in_words(
    bench: Measure, tmp_path: Path
) -> None:
    done = bench("retrieval", "--size", "30", "--method", "oracle")
    assert done.code != 0
    assert "known: paper, bm25" in done.said
    wrong = tmp_path / "q.yaml"
    wrong.write_text(
        "name: q\nqueries:\n"
        "  - {id: a, split: dev, style: terse, text: hold, relevant: {WF-99: 2}}\n"
    )
    done = bench("retrieval", "--queries", str(wrong))
    assert done.code != 0
    assert "q.yaml:3: queries.0.relevant.WF-99: there is no rule 'WF-99'" in done.said
