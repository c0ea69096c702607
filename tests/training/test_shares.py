"""Of each kind of samples so many are learnt as its share says, always the same ones."""

from hypothesis import given
from hypothesis import strategies as st
from pa_training.samples.selection import drawn

from pa_training.samples.sample import Sample


def samples(kind: str, number: int = 200) -> list[Sample]:
    return [
        Sample(
            group="g",
            system="",
            picture="",
            rest=f"mission {n}",
            answer="",
            task="planner",
            kind=kind,
        )
        for n in range(number)
    ]


@given(st.floats(0, 1), st.floats(0, 1), st.integers(0, 99))
def test_a_larger_share_holds_a_smaller_one(one: float, other: float, seed: int) -> None:
    small, large = sorted((one, other))
    few = list(drawn(samples("go/plain"), {"go": small}, seed))
    many = list(drawn(samples("go/plain"), {"go": large}, seed))
    assert all(sample in many for sample in few)


def test_kinds_have_shares_of_their_own() -> None:
    shares = {"compound": 0.0, "compound/spoken": 1.0, "others": 0.0}
    assert not list(drawn(samples("compound/2"), shares, 0))
    assert len(list(drawn(samples("compound/2/spoken"), shares, 0))) == 200
    assert not list(drawn(samples("go/spoken"), shares, 0))
    assert len(list(drawn(samples("go/plain"), {"compound": 0.0}, 0))) == 200
    assert 60 < len(list(drawn(samples("go/plain"), {"others": 0.5}, 0))) < 140
