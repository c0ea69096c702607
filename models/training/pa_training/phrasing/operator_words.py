"""The words in which orders are given, most frequent first: what the spelling of missions knows.

`python -m pa_training.phrasing.operator_words` prints `rules/vocabulary/operators.txt`.
"""

from collections import Counter

from pa_training.phrasing.misspelling import KEPT, SHORT
from pa_training.phrasing.phrase_bank import PhraseBank, phrase_bank

FEWEST = 3
"""Templates that use a word which is listed."""
HEADING = """\
# Words that operators use, most frequent first: a misspelt word of a mission is read as the
# likeliest of them, of the world's own names or of an English dictionary. Counted in the phrases
# that the default model's adapters are trained on (pa_training/phrasing/operator_words.py),
# without what it keeps from training. Add the words of your site anywhere, one a line: a word that
# stands here is never taken for a slip.
"""


def operator_words(bank: PhraseBank) -> list[str]:
    """Return the words of the training side of `bank`, the more templates use one the earlier.

    Short message spellings and words on which the meaning turns are there in any case.
    """
    used = Counter(
        word
        for key in bank.keys
        for entry in bank.entries(key)
        if entry.split == "train"
        for word in entry.template.words
        if word.isalpha()
    )
    common = sorted((w for w in used if used[w] >= FEWEST), key=lambda word: (-used[word], word))
    short = (word for word in SHORT.values() if word.isalpha())
    return list(dict.fromkeys((*common, *short, *sorted(KEPT))))


def main() -> None:
    """Print the file."""
    print(HEADING + "\n".join(operator_words(phrase_bank())))


if __name__ == "__main__":
    main()
