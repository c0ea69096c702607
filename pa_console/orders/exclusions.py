"""The assets and places that the words of an order rule out: *a robot, but not Robot_T01*.

The exclusions are independent of the models: no plan uses an excluded name, whatever was read. A
name is excluded only if every mention of it is; *not Drone_T04 to NorthGate, but Drone_T04 to
SouthGate* is a matter of demands (`demands.py`). Quoted words are no part of the order.
"""

import re
from collections.abc import Iterator

from pa_console.orders.name_linking import LinkedText
from pa_console.orders.verb_lexicon import find_verbs
from pa_console.orders.world_names import WorldNames
from pa_console.schema.world import World

_QUOTED = re.compile(r"\"[^\"]*\"|“[^”]*”|(?<!\w)'[^']{3,}'(?!\w)")
_BEFORE = (
    r"(?:\bnot(?: that)?|\bexcept(?:ing)?(?: for)?|\bwith the exception of|\bexclud(?:e|ing)"
    r"|\bexcl\.?|\bother than|\b(?:any|every|some|no)(?: ?one| ?body)? but|\bany \w+ but|\bskip"
    r"|\b(?:apart|aside) from|\bsave for|\bwithout(?: using| touching)|\bminus|\bw/o"
    r"|\bhands off|\bleav(?:e|ing) out|\bnegative on|\bnever|\bunder no circumstances"
    r"|\bforget about|\bas long as it(?: is|['’]s)(?: not|n['’]t)"
    r"|(?:\bnot|n['’]t|\bnever|\bdont)(?: you)?(?: dare)?"
    r" (?:use|take|pick|choose|touch|involve|task|commit|include|send)"
    r"|\b(?:another(?: one)?|some(?: ?one| ?body) else|others?) than)"
)
"""Phrases that exclude the names after them."""
_AFTER = (
    r"(?: (?:is|are)(?: strictly| absolutely)? (?:off[ -]limits|out of bounds|excluded|exempt"
    r"|not (?:to be|an option|allowed|part of|in on)|spoken for)"
    r"|,? ex(?:cluded|cepted)\b| (?:does|do)(?: not|n['’]t) count"
    r"| (?:sits?|stays?|is|are|remains?)(?: this(?: one)?)? out of (?:it|this|that)"
    r"| sits? this (?:one )?out| (?:must|may|shall|should)(?: not|n['’]t) be"
    r" (?:used|chosen|sent|taken|touched|picked|tasked|committed))"
)
"""Phrases that exclude the names before them."""
_AROUND = (
    r"(?:\b(?:leave|leaving|keep|keeping|count) (?P<kept>{names}) out\b"
    r"|(?:\bnot|n['’]t) (?:want|have) (?P<unwanted>{names}) (?:(?:in|on) (?:it|this)|do(?:ing)?))"
)
_COMPASS = re.compile(r"\b(?:north|east|south|west)\b", re.IGNORECASE)
_FILLERS = r"(?:,? (?:please|though|to|the|for|with|at all))*"


def excluded_names(world: World, text: str) -> tuple[str, ...]:
    """Return the assets and places of which `text` excludes every mention.

    Text without a verb and a place corrects the previous order (*not Drone_T04, Robot_T02*), and
    the asset that it names may have to come back.
    """
    blank = _QUOTED.sub(lambda quoted: " " * len(quoted[0]), text)
    said = LinkedText.of(world, blank).text
    said = _COMPASS.sub(lambda found: _gate_towards(world, found[0]), said)
    known = sorted((*world.assets, *world.frames), key=len, reverse=True)
    one = rf"\b(?:{'|'.join(map(re.escape, known))})\b"
    names = (
        rf"{one}(?:(?:, {one})*,? (?:and|or|nor|plus|&) (?:the |not )?{one})?(?!,? wh(?:o|ich)\b)"
    )
    placed = any(re.search(rf"\b{place}\b", said) for place in world.frames)
    if not placed and not any(verb.plain for verb in find_verbs(said)):
        return ()
    ruled_out = [*_ruled_out(said, names)]
    found = dict.fromkeys(
        mention[0]
        for mention in re.finditer(one, said)
        if any(start <= mention.start() < end for start, end in ruled_out)
    )
    kept = {
        mention[0]
        for mention in re.finditer(one, said)
        if not any(start <= mention.start() < end for start, end in ruled_out)
    }
    return tuple(name for name in found if name not in kept)


def _gate_towards(world: World, word: str) -> str:
    """Return the gate whose name is a point of the compass, or the `word` itself."""
    return WorldNames.of(world).gate_with(word.lower()) or word


def _ruled_out(said: str, names: str) -> Iterator[tuple[int, int]]:
    """Yield the ranges of characters with excluded names."""
    before = rf"(?P<lead>{_BEFORE}{_FILLERS}) (?P<names>{names})"
    for match in re.finditer(before, said, re.IGNORECASE):
        if not (match["lead"].lower().endswith("send") and said[match.end() :].startswith(" to ")):
            yield match.span("names")
    for match in re.finditer(rf"(?P<names>{names}){_AFTER}", said, re.IGNORECASE):
        yield match.span("names")
    around = _AROUND.replace("{names}", names)
    for match in re.finditer(around, said, re.IGNORECASE):
        yield match.span("kept" if match["kept"] else "unwanted")
