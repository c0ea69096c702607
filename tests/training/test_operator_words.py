"""The shipped words of operators are those of the phrase bank, but not of what is kept from it."""

from pa_training.phrasing.operator_words import operator_words
from pa_training.phrasing.phrase_bank import PhraseBank, phrase_bank

from pa_console.resources import data_folder


def test_the_shipped_list_has_every_word_of_the_phrase_bank_in_its_order() -> None:
    shipped = (data_folder() / "rules/vocabulary/operators.txt").read_text("utf-8").splitlines()
    words = operator_words(phrase_bank())
    assert [word for word in shipped if word in {*words}] == words


def test_words_that_training_never_sees_are_not_listed() -> None:
    bank = phrase_bank()
    kept = {
        key: [entry for entry in bank.entries(key) if entry.split == "heldout"] for key in bank.keys
    }
    assert "gate" in operator_words(bank)
    assert "gate" not in operator_words(PhraseBank(kept))
