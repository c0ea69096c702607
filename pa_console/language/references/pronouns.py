"""Pronouns that refer to earlier orders: *it*, *they*, *there*, *where it came from*."""

import re

from pa_console.language.canonical.reading import listed
from pa_console.language.lexicon import word_lists
from pa_console.language.references.conversation import (
    HOME,
    IT,
    THEM,
    THERE,
    THEY,
    ResolvedOrder,
    ResolvedReference,
    Turn,
    Unclear,
    substituted,
)
from pa_console.language.references.reader import CONTACTS, INDEFINITE, Reader

_WORDS = word_lists("conversation")
_HER = frozenset(_WORDS["her"])
"""Words after which *her* is not a possessive."""
_SOMEBODY = frozenset((*CONTACTS, *_WORDS["somebody"]))
_ENCOUNTER = frozenset(_WORDS["encounter"])
"""Verbs whose object is a contact, never an asset."""
_EXISTENTIAL = frozenset(_WORDS["existential"])
_WEATHER = frozenset(_WORDS["weather"])
"""Verbs and nouns after an *it* that does not mean an asset."""


class Pronouns:
    """The pronouns of one order, and the assets and places that they mean."""

    def __init__(self, turn: Turn) -> None:
        self._turn = turn

    def last_asset(self) -> list[str] | Unclear:
        """Return the asset that was moved last, or a question if there are several."""
        turn = self._turn
        pointer, reported = turn.scene.pointer, turn.scene.asked_about
        marked = [pointer] if pointer in turn.scene.world.assets else []
        if marked and turn.has("that one", "this one"):
            return marked
        candidates = list(dict.fromkeys((*marked, *([reported] if reported else turn.movers))))
        if len(candidates) < 2:
            return candidates
        match = re.search(rf"\b(?:{'|'.join(IT)})\b", turn.text, re.IGNORECASE)
        pronoun = match[0] if match is not None else "it"
        return Unclear(
            pronoun, f"Which asset is meant by “{pronoun}”?", tuple(candidates), describes=True
        )

    def last_assets(self) -> list[str]:
        """Return the assets of the last mission; if it moved one, also the asset moved before."""
        turn = self._turn
        if len(turn.movers) > 1:
            return turn.movers
        every = list(dict.fromkeys(move.agent for move in reversed(turn.scene.moved)))
        return list(reversed(every[:2]))

    def resolved(self) -> ResolvedOrder | Unclear | None:
        """Replace *it*, *them* and *there*, unless they refer to words of the same order."""
        turn = self._turn
        references: list[ResolvedReference] = []
        at = 0
        while at < len(turn.tokens):
            result = self._pronoun(at, within=bool(references))
            if isinstance(result, Unclear):
                return result if turn.asks else None
            if result is None:
                at += 1
                continue
            reference, at = result
            references.append(reference)
        if not references or not turn.asks:
            return None
        pairs = tuple(
            (reference.words, reference.means) for reference in references if reference.means
        )
        return ResolvedOrder(substituted(turn.text, references), pairs)

    def _pronoun(self, at: int, *, within: bool) -> tuple[ResolvedReference, int] | Unclear | None:
        """Read a pronoun; `within` is True if a pronoun before it in the order was replaced."""
        turn = self._turn
        reader = Reader(turn.tokens, at)
        named = [mention for mention in turn.assets if mention.at < at and not mention.ruled_out]
        placed = [mention for mention in turn.places if mention.at < at and not mention.ruled_out]
        if reader.take("where it was", "where it came from", "where it stood", "its old gate"):
            before = [
                turn.scene.place_of(move.agent) if within else move.before for move in turn.moves
            ]
            place = before[-1] if before else ""
            return self._replaced(at, reader.at, place, to=True) if place else None
        if self._is_existential(at):
            return None
        if reader.take(*THERE):
            return None if placed else self._there_named(at, reader.at)
        return None if named or self._is_contact(at) else self._asset_pronoun(at, within=within)

    def _asset_pronoun(
        self, at: int, *, within: bool
    ) -> tuple[ResolvedReference, int] | Unclear | None:
        """Read *it*, *he* or *they*; *both* after another pronoun adds nothing."""
        turn = self._turn
        reader = Reader(turn.tokens, at)
        if within and reader.take("both"):
            both = turn.tokens[at]
            return ResolvedReference(both.start, both.end, both.written, ""), reader.at
        if reader.take(*THEM, *THEY) and reader.word() not in ("of", "robots", "drones"):
            they = self.last_assets()
            return self._replaced(at, reader.at, listed(they)) if they else None
        reader.at = at
        if reader.take(*IT) and not (_WEATHER & {reader.word(), reader.word(1), reader.word(2)}):
            assets = self.last_asset()
            if isinstance(assets, Unclear):
                return assets
            return self._replaced(at, reader.at, assets[0]) if assets else None
        return None

    def _is_existential(self, at: int) -> bool:
        """Return whether *there* does not mean a place: *there is a car*, *is there anybody*."""
        turn = self._turn
        if turn.words[at] != "there":
            return False
        after, before = turn.words[at + 1 : at + 2], turn.words[at - 1 : at] if at else []
        questioned = bool(_EXISTENTIAL & {*before}) and bool({*after} & (INDEFINITE | _SOMEBODY))
        return questioned or bool(_EXISTENTIAL & {*after})

    def _is_contact(self, at: int) -> bool:
        """Return whether the pronoun at token `at` is a possessive or means a contact.

        It means a contact if a contact is mentioned before it and nothing is to come back, or if
        its verb is used only for contacts.
        """
        turn = self._turn
        if turn.words[at] == "her" and turn.words[at + 1 : at + 2]:
            after = turn.words[at + 1]
            if after[0].isalnum() and after not in _HER:
                return True
        if at and turn.words[at - 1] in _ENCOUNTER:
            return True
        back = (HOME | {"back"}) & set(turn.words)
        return not back and bool(_SOMEBODY & set(turn.words[:at]))

    def _there_named(self, at: int, end: int) -> tuple[ResolvedReference, int] | Unclear | None:
        """Replace a word such as *there* by its place; if several fit, ask which one is meant."""
        turn = self._turn
        if turn.there:
            return self._replaced(at, end, turn.there, to=True)
        if not turn.theres:
            return None
        words = turn.text[turn.tokens[at].start : turn.tokens[end - 1].end]
        return Unclear(words, f"Which place is “{words}”?", tuple(turn.theres), describes=True)

    def _replaced(
        self, at: int, end: int, means: str, *, to: bool = False
    ) -> tuple[ResolvedReference, int]:
        turn = self._turn
        first, last = turn.tokens[at], turn.tokens[end - 1]
        words = turn.text[first.start : last.end]
        before = turn.words[at - 1] if at else ""
        prefixed = to and before not in ("to", "at", "over", "from", "the")
        becomes = ""
        if prefixed:
            preposition = "at" if {"is", "are", "see", "report"} & set(turn.words[:at]) else "to"
            preposition = (
                "to" if {"send", "go", "goes", "move", "to"} & set(turn.words[:at]) else preposition
            )
            becomes = f"{preposition} {means}"
        return ResolvedReference(first.start, last.end, words, means, becomes), end
