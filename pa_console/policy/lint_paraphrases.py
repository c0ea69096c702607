"""Says a rule in other words, as operators do, and finds the rules that this does not bring up.

The other words come from the vocabulary that retrieval uses, so that the method fits any rule.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from pa_console.policy.lint_search import Doubt
from pa_console.policy.retriever import Retriever
from pa_console.policy.terms import words_of
from pa_console.policy.vocabulary import Groups, default_vocabulary
from pa_console.schema.rule import Rule
from pa_console.schema.vocabulary import Vocabulary

FOUND_AMONG = 3
"""How many rules are retrieved for a mission beside the pinned ones (paper, Step 3)."""

FEWEST = 0.5
"""Of a rule's paraphrases, at least this share has to find it."""


class Paraphraser:
    """Makes paraphrases of rules; equal rules give equal paraphrases."""

    def __init__(self, vocabulary: Vocabulary | None = None) -> None:
        """`vocabulary` gives the synonyms; default: the installed one."""
        known = default_vocabulary() if vocabulary is None else vocabulary
        self._groups = Groups(known)
        self._members = tuple(known.groups.values())

    def paraphrases(self, rule: Rule) -> dict[str, str]:
        """Return other words for `rule` by how they were made.

        Its words backwards, every other one left out, half of them or all replaced by synonyms,
        its tags, and the missions of its examples.
        """
        words = [word for word in words_of(rule.text) if word not in self._groups.ignored]
        other = [self._synonym(word, number) for number, word in enumerate(words)]
        texts = {
            "word order": words[::-1],
            "first half left out": words[len(words) // 2 :],
            "every second word": words[::2],
            "every other second word": words[1::2],
            "synonyms for every second word": _mixed(words, other, 0),
            "synonyms for every other second word": _mixed(words, other, 1),
            "tags": words_of(" ".join(rule.tags)),
        }
        made = {name: " ".join(parts) for name, parts in texts.items() if parts}
        missions = dict.fromkeys(e.mission for e in rule.examples if e.mission)
        made |= {f"mission {text!r}": text for text in missions}
        return made

    def _synonym(self, word: str, number: int) -> str:
        """Return another word of the group that `word` fits best, itself if there is none."""
        fit = self._groups.fit(word)
        if not len(fit) or not fit.any():
            return word
        members = [m for m in self._members[int(np.argmax(fit))] if m != word]
        return members[number % len(members)] if members else word


def hard_to_retrieve(
    rules: Sequence[Rule], paraphraser: Paraphraser | None = None
) -> Iterator[Doubt]:
    """Yield the rules that less than FEWEST of their paraphrases find among FOUND_AMONG.

    Critical rules are always shown to the models, and so are never hard to retrieve. A rule that
    not even its own text finds needs no paraphrase to tell.
    """
    made = paraphraser or Paraphraser()
    retriever = Retriever(rules)
    for rule in rules:
        if rule.priority == "critical" or not _finds(retriever, rule.text, rule):
            continue
        texts = made.paraphrases(rule)
        lost = [name for name, text in texts.items() if not _finds(retriever, text, rule)]
        found = len(texts) - len(lost)
        if found < FEWEST * len(texts):
            problem = (
                f"only {found} of {len(texts)} paraphrases find it, not: {', '.join(lost[:3])}"
                f"{f' and {len(lost) - 3} more' if len(lost) > 3 else ''}"
            )
            remedy = "give it tags that operators use, or words of its own"
            yield Doubt(rule, "text", "hard to retrieve", problem, remedy)


def _finds(retriever: Retriever, text: str, rule: Rule) -> bool:
    return rule.id in {hit.rule_id for hit in retriever.retrieve(text, FOUND_AMONG)}


def _mixed(words: Sequence[str], other: Sequence[str], odd: int) -> list[str]:
    """Return `words` with every second one taken from `other`."""
    return [
        b if number % 2 == odd else a
        for number, (a, b) in enumerate(zip(words, other, strict=True))
    ]
