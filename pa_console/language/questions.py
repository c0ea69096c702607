"""A grammar for questions to the console, such as *Why not the robot?*.

The whole text must be such a question. A text with more than that is an order, as in *Why is nobody
there? Send someone.* *Why not send the robot?* is an order too, because it asks for an action. The
grammar is written by hand and parses from left to right. A text that it cannot parse is not a
question.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from pa_console.language.lexicon import word_lists
from pa_console.language.name_linking import link_names
from pa_console.language.references.description import fitting, is_bare
from pa_console.language.references.description_grammar import find_descriptions
from pa_console.language.references.reader import BARE, Reader, asset_at, place_at, read_tokens
from pa_console.language.references.scene import ReferenceScene
from pa_console.schema.events.intake import QuestionTopic

_WORDS = word_lists("questions")
MOST_WORDS = 24
"""The largest number of words in a text that is read as a question."""

_SUGGESTING = ("do", "does")
"""Verbs that may give an order with *not*: *Why don't you stop?*"""


@dataclass(frozen=True)
class Question:
    """A question in the operator's words.

    `subjects` are the assets that it may mean, or a gate; empty if it is about the whole plan.
    """

    text: str
    topic: QuestionTopic
    subjects: tuple[str, ...] = ()


class _TopicWords(NamedTuple):
    topic: QuestionTopic
    subjects: tuple[str, ...] = ()


def read_question(scene: ReferenceScene, text: str) -> Question | None:
    """Return the question that `text` asks of the console; None for any other text."""
    linked = link_names(scene.world, text)
    tokens = read_tokens(linked)
    if not tokens or len(tokens) > MOST_WORDS:
        return None
    grammar = _Grammar(scene, linked, Reader(tokens))
    question = grammar.question()
    return Question(text, question.topic, question.subjects) if question is not None else None


class _Grammar:
    """A parser that tries the forms of questions one after another."""

    def __init__(self, scene: ReferenceScene, text: str, reader: Reader) -> None:
        self._scene, self._text, self._reader = scene, text, reader

    def question(self) -> _TopicWords | None:
        reader = self._reader
        while reader.take(*_WORDS["opening"]):
            pass
        ways: tuple[Callable[[], _TopicWords | None], ...] = (
            self._alternatives, self._against, self._why_gate, self._why_plan, self._why_asset,
            self._why_not_asset,
        )  # fmt: skip
        start = reader.at
        for way in ways:
            reader.at = start
            topic = way()
            if topic is not None and self._ended():
                return topic
        return None

    def _ended(self) -> bool:
        """Skip closing words, and return whether the text ends after them."""
        self._reader.skip(_WORDS["closing"])
        return self._reader.over

    def _why(self) -> bool:
        return bool(self._reader.take(*_WORDS["why"]))

    # ------------------------------------------------------------------ why this plan

    def _why_plan(self) -> _TopicWords | None:
        """Read *Why?*, *why that plan*, *why was it refused*, *why can't I approve it*."""
        reader = self._reader
        if not self._why():
            return None
        reader.take(",")
        if reader.take(*_WORDS["that"]) and self._at_end():
            return _TopicWords("plan")
        reader.take("not")
        if self._at_end():
            return _TopicWords("plan")
        auxiliary = reader.take_in(_WORDS["auxiliaries"])
        if not auxiliary and not reader.take(*_WORDS["plan_subjects"]):
            return None
        if reader.take("not") and auxiliary in _SUGGESTING:
            return None
        reader.take(*_WORDS["plan_subjects"])
        reader.take_in(_WORDS["auxiliaries"])
        reader.skip(_WORDS["nothing_else"])
        return _TopicWords("plan") if reader.take(*_WORDS["done_to_plan"]) else None

    def _at_end(self) -> bool:
        """Return whether the text ends after closing words, without skipping them."""
        start = self._reader.at
        ended = self._ended()
        self._reader.at = start
        return ended

    # ------------------------------------------------------------------ why this asset, why not

    def _why_asset(self) -> _TopicWords | None:
        """Read *why Drone_T04*, *why did you send the robot*, *why is that drone going there*.

        With a comma, the words are an order: *Explain, robot to south*.
        """
        reader = self._reader
        if not self._why():
            return None
        if subjects := self._assets():
            if reader.take(*_WORDS["instead_of"]):
                others = self._assets()
                return _TopicWords("other_asset", others) if others else None
            self._task()
            return _TopicWords("asset", subjects)
        if not reader.take_in(_WORDS["auxiliaries"]):
            return None
        return self._sending(negated=False)

    def _why_not_asset(self) -> _TopicWords | None:
        """Read *why not the robot*, *why didn't you send Robot_T02*, *why is he not sent*.

        *Why don't you send the robot?* is not read, because it asks for an action.
        """
        reader = self._reader
        if not self._why():
            return None
        if reader.take("not"):
            reader.take("with", "use")
            subjects = self._assets()
            reader.take("instead")
            self._place()
            reader.take("instead")
            return _TopicWords("other_asset", subjects) if subjects else None
        auxiliary = reader.take_in(_WORDS["auxiliaries"])
        suggests = auxiliary in _SUGGESTING and reader.word() == "not"
        return self._sending(negated=True) if auxiliary and not suggests else None

    def _sending(self, *, negated: bool) -> _TopicWords | None:
        """Read which asset was or was not sent: *you send the robot*, *the robot not going*."""
        reader = self._reader
        no = bool(reader.take("not"))
        if reader.take("it"):
            subjects = self._assets()
            return _TopicWords("asset", subjects) if subjects and not (no or negated) else None
        if reader.take(*_WORDS["speakers"]):
            no = bool(reader.take("not")) or no
            if not reader.take_in(_WORDS["sending"]):
                return None
            reader.take("with", "for", "on")
            subjects = self._assets()
        else:
            subjects = self._assets()
            no = bool(reader.take("not")) or no
            reader.take("being", "been", "to be", "the one")
            if subjects and not reader.take_in(_WORDS["sending"]):
                return None
        self._task()
        if not subjects or no != negated:
            return None
        return _TopicWords("other_asset" if no else "asset", subjects)

    def _against(self) -> _TopicWords | None:
        """Read *what speaks against the robot*."""
        if not self._reader.take(*_WORDS["against"]):
            return None
        if self._reader.take(*_WORDS["that"]) and self._at_end():
            return _TopicWords("plan")
        subjects = self._assets()
        self._task()
        return _TopicWords("other_asset", subjects) if subjects else None

    def _task(self) -> None:
        """Read the place or purpose for which an asset is sent: *to the gate*, *for that*."""
        reader = self._reader
        reader.take("instead")
        self._place()
        reader.take("for that", "for this", "for it", "and nobody else", "of all", "instead")

    def _place(self) -> None:
        reader, start = self._reader, self._reader.at
        if reader.take("over there", "there", "back home", "home", "back", "away"):
            return
        if reader.take("over to", "to", "at", "for", "towards") and not place_at(
            self._scene, reader
        ):
            reader.at = start

    def _assets(self) -> tuple[str, ...]:
        """Read assets: a name, the marked asset, a description or a kind.

        A kind means all its assets. The result is empty if the words name no asset.
        """
        reader, scene = self._reader, self._scene
        if name := asset_at(scene, reader):
            return (name,)
        start = reader.at
        if reader.take("that one", "this one", "him", "her"):
            marked = scene.pointer in scene.world.assets
            return (scene.pointer,) if marked else ()
        if described := self._described():
            return described
        reader.take(
            *("that", "this", "the other", "the", "another", "an", "a", "one of the", "our"),
            *("those", "these", "any", "some", "one"),
        )
        reader.take("other", "free", "nearer", "idle", "ground")
        team = scene.members(reader.word())
        if not team:
            reader.at = start
            return ()
        reader.at += 1
        return scene.in_order(team)

    def _described(self) -> tuple[str, ...]:
        """Read a description of an asset at the cursor; return the assets that fit it."""
        reader, tokens = self._reader, self._reader.tokens
        if reader.over:
            return ()
        begins = tokens[reader.at].start
        for description in find_descriptions(self._scene, tokens, self._text):
            if description.start != begins or description.sort != "asset":
                continue
            if (
                description.ranking is not None
                and description.ranking.distance
                and not description.ranking.place
            ):
                return ()
            names = fitting(self._scene, description)
            if names:
                reader.at = next(
                    (n for n, token in enumerate(tokens) if token.start >= description.end),
                    len(tokens),
                )
            return names
        return ()

    # ------------------------------------------------------------------ why a gate is bare

    def _why_gate(self) -> _TopicWords | None:
        """Read *why is nobody at the north gate*, *why has the gate no guard*."""
        reader = self._reader
        if not self._why():
            return None
        auxiliary = reader.take_in(_WORDS["auxiliaries"])
        reader.take("there")
        if auxiliary and reader.take(*_WORDS["nobody"]):
            reader.take("there", "left", "standing")
            gate = self._gate() if reader.take(*_WORDS["at"]) else ""
            return _TopicWords("gate", (gate,)) if gate else None
        reader.take("you", "we", "they")
        leaves = bool(reader.take("leave", "left", "leaving"))
        gate = self._gate()
        if not gate or not auxiliary:
            return None
        reader.take("still", "suddenly", "always", "currently")
        bare = reader.take_in(BARE) or reader.take(*(f"not {way}" for way in _WORDS["guarded"]))
        bare = bare or reader.take("without a guard", "without guard", "without cover", "alone")
        if not bare and not leaves and reader.take("have", "got", ""):
            bare = reader.take("no guard", "no guards", "no cover", "nobody")
        if not bare and auxiliary in ("has", "had", "does"):
            bare = reader.take("no guard", "no guards", "no cover", "nobody", "lost its guard")
        return _TopicWords("gate", (gate,)) if bare else None

    def _gate(self) -> str:
        """Read a gate: its name, the marked gate, or the only gate without a guard."""
        reader, scene = self._reader, self._scene
        start = reader.at
        place = place_at(scene, reader)
        if place:
            return place if place in scene.gates else ""
        if reader.take("this gate", "that gate") and scene.pointer in scene.gates:
            return scene.pointer
        reader.at = start
        bare = [gate for gate in scene.gates if is_bare(scene, gate)]
        if reader.take("the gate", "this gate", "that gate", "a gate") and len(bare) == 1:
            return bare[0]
        reader.at = start
        return ""

    # ------------------------------------------------------------------ alternatives

    def _alternatives(self) -> _TopicWords | None:
        """Read *What would you do instead*, *what else could we do*, *any other option*."""
        forms = (self._what_else, self._how_else, self._other_options, self._differently)
        start = self._reader.at
        for form in forms:
            self._reader.at = start
            if form() and self._at_end():
                return _TopicWords("alternatives")
        return None

    def _what_else(self) -> bool:
        """Read *what else*, *what would you do otherwise*, *what else is there*."""
        reader = self._reader
        if not reader.take("what"):
            return False
        other = bool(reader.take_in(_WORDS["else"]))
        if other and self._at_end():
            return True
        if other and reader.take("is there", "is possible", "is on offer", "would work", "is left"):
            return True
        if not reader.take_in(_WORDS["would"]):
            return False
        if not reader.take(*_WORDS["whose_turn"]) and not other:
            return False
        other = bool(reader.take_in(_WORDS["else"])) or other
        if not reader.take(*_WORDS["doing"]):
            return False
        reader.take(*_WORDS["about_it"])
        other = (
            bool(reader.take(*_WORDS["instead_of_it"]) or reader.take_in(_WORDS["else"])) or other
        )
        reader.take(*_WORDS["about_it"])
        return other

    def _how_else(self) -> bool:
        """Read *how else*, *how else could we do that*."""
        reader = self._reader
        if not reader.take("how else", "how otherwise"):
            return False
        if self._at_end():
            return True
        if not reader.take_in(_WORDS["would"]):
            return False
        return bool(
            reader.take("it be done", "this be done", "that be done")
            or (
                reader.take(*_WORDS["whose_turn"])
                and reader.take("do it", "do this", "do that", "do so")
            )
        )

    def _other_options(self) -> bool:
        """Read *is there another way*, *any other option*, *show me other plans*."""
        reader = self._reader
        reader.take(*_WORDS["is_there"])
        reader.take(*_WORDS["articles"])
        reader.take("sound", "good", "legal", "possible")
        if reader.take_in(_WORDS["alternatives"]):
            reader.take("plan", "plans")
        else:
            other = bool(reader.take(*_WORDS["other"]))
            reader.take("possible", "sound", "good")
            if not other or not reader.take_in(_WORDS["options"]):
                return False
        reader.take(*_WORDS["instead_of_it"], "instead")
        reader.take(*_WORDS["about_it"])
        return True

    def _differently(self) -> bool:
        """Read *can it be done differently*, *could you do that another way*."""
        reader = self._reader
        if not reader.take("can", "could", "would", "might"):
            return False
        if not reader.take(
            *("it be done", "this be done", "that be done", "you do it", "you do this"),
            *("you do that", "we do it", "we do this", "we do that", "one do it", "one do that"),
        ):
            return False
        return bool(
            reader.take_in(_WORDS["else"])
            or reader.take("another way", "in another way", "any other way", "some other way")
        )
