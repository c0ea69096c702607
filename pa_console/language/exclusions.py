"""The assets and places that the words of an order rule out: *a robot, but not Robot_T01*.

Exclusions do not depend on the models: whatever the reading, no plan uses an excluded name. A name
is excluded only if all its mentions are excluded; `demands.py` handles *not Drone_T04 to NorthGate,
but Drone_T04 to SouthGate*. Quoted words are not part of the order.
"""

import re
from collections.abc import Iterator, Sequence

from pa_console.language.lexicon import find_verbs
from pa_console.language.name_linking import LinkedText, WorldNames
from pa_console.schema.world import World

_QUOTED = re.compile(r"\"[^\"]*\"|“[^”]*”|(?<!\w)'[^']{3,}'(?!\w)")
_BEFORE = (
    r"(?:(?<!if )(?<!why )(?<!or )\bnot(?: that)?|\bexcept(?:ing)?(?: for)?"
    r"|\bwith the exception of|\bexclud(?:e|ing)|\bexcl\.?|\bother than|\bskip"
    r"|\b(?:any|every|some|no)(?: ?one| ?body)? but|\bany(?:one|body)? (?:\w+ ){1,3}but"
    r"|\bany of (?:\w+|['’]em) but|\b(?:apart|aside) from|\bsave for"
    r"|\bwithout(?: using| touching)|\bminus|\bw/o|\bhands off|\bleav(?:e|ing) out"
    r"|\bnegative on|\bnever|\bunder no circumstances|\bforget about|\bneither"
    r"|\b(?:as|so) long as it(?: is not| isn['’]t| ain['’]t|['’]s not)"
    r"|(?:\bnot|\bcan['’]t|\bmustn['’]t) be"
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
    r" (?:used|chosen|sent|taken|touched|picked|tasked|committed)"
    r"|,? (?:must|may|shall|should)(?: not|n['’]t) (?:go|move)\b)"
)
"""Phrases that exclude the names before them."""
_AROUND = (
    r"(?:\b(?:leave|leaving|keep|keeping|count) (?P<kept>{names}) out\b"
    r"|(?:\bnot|n['’]t) (?:want|have) (?P<unwanted>{names}) (?:(?:in|on) (?:it|this)|do(?:ing)?))"
)
_COMPASS = re.compile(r"\b(?:north|east|south|west)\b", re.IGNORECASE)
_NAME = re.compile(r"[A-Za-z0-9_]+")
_NOT_ALONE = re.compile(r"\W*(?:(?:no|nope|sorry)\W+)?not (?:the )?", re.IGNORECASE)
_FILLERS = r"(?:,? (?:please|though|to|the|for|with|at all))*"


def excluded_names(world: World, text: str) -> tuple[str, ...]:
    """Return the assets and places that `text` excludes wherever it mentions them.

    *Not Drone_T04, the robot* and *Robot_T02, not Drone_T04* correct the previous order. They
    exclude nothing, because the corrected asset may have to come back.
    """
    blank = _QUOTED.sub(lambda quoted: " " * len(quoted[0]), text)
    linked_text = LinkedText.of(world, blank).text
    linked_text = _COMPASS.sub(lambda match: _gate_towards(world, match[0]), linked_text)
    names = {*world.assets, *world.frames}
    mentions = [match for match in _NAME.finditer(linked_text) if match[0] in names]
    if not mentions or _corrects_the_last(world, linked_text, mentions):
        return ()
    any_name = rf"\b(?:{'|'.join(dict.fromkeys(match[0] for match in mentions))})\b"
    ranges = [*_ruled_out(linked_text, _listed(any_name))]
    kept = {
        match[0]
        for match in mentions
        if not any(start <= match.start() < end for start, end in ranges)
    }
    return tuple(dict.fromkeys(match[0] for match in mentions if match[0] not in kept))


def _listed(any_name: str) -> str:
    """Return the expression for a list of names that match `any_name`."""
    more_names = rf"(?:, {any_name})*,? (?:and|or|nor|plus|&) (?:the |not )?{any_name}"
    return rf"{any_name}(?:{more_names})?(?!,? wh(?:o|ich)\b)"


def _corrects_the_last(world: World, text: str, mentions: Sequence[re.Match[str]]) -> bool:
    """Return whether `text` corrects the last order.

    It does if it only names assets, as in *not Drone_T04*, without a place or a verb.
    """
    first, last = mentions[0], mentions[-1]
    begins = _NOT_ALONE.fullmatch(text[: first.start()]) is not None
    between = text[first.end() : last.start()].strip(" ,.;:-").lower()
    ends = len(mentions) > 1 and between == "not" and not text[last.end() :].strip(" .!")
    placed = any(mention[0] in world.frames for mention in mentions)
    return (begins or ends) and not placed and not any(verb.plain for verb in find_verbs(text))


def _gate_towards(world: World, word: str) -> str:
    """Return the gate named after the compass direction `word`, or `word` if there is none."""
    return WorldNames.of(world).gate_with(word.lower()) or word


def _ruled_out(text: str, names: str) -> Iterator[tuple[int, int]]:
    """Yield the character ranges of excluded names."""
    before = rf"(?P<lead>{_BEFORE}{_FILLERS}) (?P<names>{names})"
    for match in re.finditer(before, text, re.IGNORECASE):
        if not (match["lead"].lower().endswith("send") and text[match.end() :].startswith(" to ")):
            yield match.span("names")
    for match in re.finditer(rf"(?P<names>{names}){_AFTER}", text, re.IGNORECASE):
        yield match.span("names")
    around = _AROUND.replace("{names}", names)
    for match in re.finditer(around, text, re.IGNORECASE):
        yield match.span("kept" if match["kept"] else "unwanted")
