"""Examples of generated missions for those who want to look at them."""

from pa_console.training.phrasing_examples import examples


def test_equal_seeds_give_equal_examples_in_the_number_asked_for() -> None:
    shown = list(examples(3, seed=3))
    assert len(shown) == 3
    assert shown == list(examples(3, seed=3))
    assert len({example.said.text for example in shown}) == 3
    assert all(example.meaning for example in shown)
