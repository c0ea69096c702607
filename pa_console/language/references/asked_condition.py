"""Questions that are followed by an order: *Is anybody at the gate? If not, send one*.

Such an order depends on the picture, so it is rewritten as an order under a condition.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from pa_console.language.canonical.order import CONDITIONS, Condition, Fact, condition_slots
from pa_console.language.lexicon import word_lists
from pa_console.language.references.reader import (
    CONTACTS,
    Reader,
    WordToken,
    asset_at,
    place_at,
    read_tokens,
)
from pa_console.language.references.scene import ReferenceScene
from pa_console.schema.world import AssetKind

_WORDS = word_lists("asked_conditions")
_SOMEBODY = _WORDS["somebody"]
_AT = _WORDS["at"]
_SO = _WORDS["so"]
_NOT_SO = _WORDS["not_so"]
_OPPOSITE: dict[Fact, Fact] = {
    "covered": "uncovered", "uncovered": "covered", "low": "not_low", "not_low": "low",
    "down": "up", "up": "down", "track_at": "no_track_at", "no_track_at": "track_at",
    "free": "none_free", "none_free": "free",
}  # fmt: skip
_FAILED = _WORDS["failed"]
_WORKING = _WORDS["working"]
_PLAIN_KIND: dict[AssetKind, str] = {"uav": "drone", "ugv": "ground vehicle", "robot": "robot"}
_STAYS_PUT = frozenset(_WORDS["stays_put"])


@dataclass(frozen=True)
class AskedCondition:
    """The condition that a question asks about."""

    condition: Condition
    subject: str
    """The gate or asset that *it* means in the order, or the kind that the question is about."""


def conditional_order(scene: ReferenceScene, text: str) -> str:
    """Rewrite a question and the order after it as an order under a condition, or return ''."""
    asking, mark, rest = text.partition("?")
    if not mark or not rest.strip():
        return ""
    question = _question(scene, read_tokens(asking))
    tokens = read_tokens(rest)
    if question is None or not tokens:
        return ""
    reader = Reader(tokens)
    fact = question.condition.fact
    if reader.take(*_NOT_SO):
        fact = _OPPOSITE[fact]
    elif not reader.take(*_SO) and fact != "free":
        return ""
    while reader.take(",", "then", ":", "-"):
        pass
    if reader.over or fact == "none_free":
        return ""
    condition = question.condition.model_copy(update={"fact": fact})
    order = _order(scene, rest, tokens[reader.at :], question)
    plain = CONDITIONS[condition.fact].plain.write(condition_slots(condition, _PLAIN_KIND))
    return f"If {plain}, {order}"


def _question(scene: ReferenceScene, tokens: Sequence[WordToken]) -> AskedCondition | None:
    reader = Reader(tokens)
    reader.take("tell me ,", "so", "hey", "well")
    nothing = bool(reader.take("nothing", "nobody", "no one"))
    opened = reader.take(
        "is there still", "is there", "are there", "is", "are", "has", "does", "do"
    )
    if free := _free(scene, reader):
        return AskedCondition(Condition(fact="free", kind=free), _PLAIN_KIND[free])
    if not nothing and (asked_condition := _of_asset(scene, reader)):
        return asked_condition
    somebody = bool(reader.take(*_SOMEBODY))
    reader.take("any", "a", "some", "an")
    reader.take("unknown", "strange")
    contact = reader.take_in(CONTACTS) if not somebody else ""
    reader.take("still", "currently", "now", "waiting", "standing", "there")
    reader.take(*_AT)
    gate = place_at(scene, reader)
    if gate not in scene.gates:
        return None
    if contact or nothing:
        kind = CONTACTS.get(contact, "")
        fact: Fact = "no_track_at" if nothing else "track_at"
        track = "vehicle" if kind == "vehicle" else "person" if kind == "person" else ""
        return AskedCondition(Condition(fact=fact, subject=gate, track=track), gate)
    covered = somebody or opened in ("is", "has", "does", "are", "do")
    reader.take("have a guard", "have anybody", "have cover", "still", "double", "well")
    if reader.take("uncovered", "unguarded", "empty", "bare", "without guard"):
        return AskedCondition(Condition(fact="uncovered", subject=gate), gate)
    reader.take("covered", "guarded", "manned", "watched")
    if covered and (reader.over or reader.word() in ("?", "now", "at", "any")):
        return AskedCondition(Condition(fact="covered", subject=gate), gate)
    return None


def _free(scene: ReferenceScene, reader: Reader) -> AssetKind | None:
    """Read *a free drone*, *a drone free*."""
    start = reader.at
    reader.take("a", "any", "one")
    early = bool(reader.take("free", "spare", "idle", "available"))
    team = scene.members(reader.word())
    if team and (early or reader.word(1) in ("free", "spare", "idle", "available")):
        return scene.world.assets[next(iter(team))].kind
    reader.at = start
    return None


def _of_asset(scene: ReferenceScene, reader: Reader) -> AskedCondition | None:
    """Read *Drone_T03 low on battery*, *Ugv_T01 failed*, *Mule_T02 still alive*."""
    name = asset_at(scene, reader)
    if not name:
        return None
    reader.take("still", "already", "running", "gone")
    if reader.take("low", "flat", "nearly empty", "almost empty"):
        return AskedCondition(Condition(fact="low", subject=name), name)
    if reader.take(*_FAILED):
        return AskedCondition(Condition(fact="down", subject=name), name)
    if reader.take(*_WORKING):
        return AskedCondition(Condition(fact="up", subject=name), name)
    return None


def _order(
    scene: ReferenceScene, rest: str, tokens: Sequence[WordToken], question: AskedCondition
) -> str:
    """Return the order, with names for *it*, *its gate* and *there*."""
    subject = question.subject
    is_gate, is_asset = subject in scene.gates, subject in scene.world.assets
    gate = subject if is_gate else scene.guarded_by(subject) if is_asset else ""
    text, done = "", tokens[0].start
    at, placed, named = 0, False, False
    while at < len(tokens):
        reader = Reader(tokens, at)
        word = ""
        if place_at(scene, reader):
            placed = True
        elif asset_at(scene, reader):
            named = True
        elif reader.take("its gate", "its post", "its place"):
            word, placed = gate, True
        elif reader.take("over there", "there"):
            word, placed = f"to {gate}" if gate else "", True
        elif reader.take("it", "that one", "one"):
            word = "" if named and not is_gate else subject if gate else f"a {subject}"
            placed = placed or is_gate
        if word:
            text += rest[done : tokens[at].start] + word
            done = tokens[reader.at - 1].end
        at = max(at + 1, reader.at)
    text += rest[done:].rstrip()
    text = text if tokens[0].written in scene.world.assets else f"{text[:1].lower()}{text[1:]}"
    words = {token.word for token in tokens}
    if is_gate and not placed and not words & _STAYS_PUT and not words & {"everyone", "nobody"}:
        text = f"{text.rstrip('.! ')} to {subject}."
    return text.replace("  ", " ")
