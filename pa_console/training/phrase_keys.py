"""The keys of the phrase banks and the slots that each of them knows."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple


class Slots(NamedTuple):
    """What a template may be filled with: it must use `needed`, and one of `either` if given."""

    needed: frozenset[str]
    allowed: frozenset[str]
    either: frozenset[str] = frozenset()


def _slots(words: str) -> Slots:
    """Read slots: `place` is needed, `track?` allowed, of `kind/kinds` at least one needed."""
    needed: set[str] = set()
    allowed: set[str] = set()
    either: set[str] = set()
    for word in words.split():
        if "/" in word:
            either.update(word.split("/"))
        elif word.endswith("?"):
            allowed.add(word[:-1])
        else:
            needed.add(word)
    return Slots(frozenset(needed), frozenset(needed | allowed | either), frozenset(either))


_LISTED = """
go.named = who place
go.kind = who place
look.named = who place track?
look.kind = who place track?
look.anyone = place track?
identify.named = who place track?
identify.kind = who place track?
identify.anyone = place track
warn.named = who place track?
warn.kind = who place track?
warn.anyone = place track
block.named = who place track?
block.kind = who place track?
block.anyone = place track?
respond.vehicle = place track
respond.person = place track
cover.failed = leaving place?
cover.bare = place
cover.kind = who place
relieve.named = who leaving place?
relieve.anyone = leaving place?
relieve.low = leaving place?
swap = a b
home.named = who base?
home.kind = who base?
home.low = who base?
stand_down = place
mass.all = place
mass.kind = who place
report.named = who
report.place = place
report.kind = who
report.all =
report.general =
hold.named = who
hold.all =
hold.leave =
others_stay =
strict_who = who
joiner = first second
joiner3 = first second third
opener.plain =
closer.plain =
opener.terse =
closer.terse =
opener.chatty =
closer.chatty =
opener.radio =
closer.radio =
who.kind.one = kind/kinds
who.kind.n = n kind/kinds
who.kind.all = kind/kinds
who.kind.origin = origin kind/kinds
who.kind.free = kind/kinds
noun.uav =
noun.ugv =
noun.robot =
noun.any =
noun.uav.plural =
noun.ugv.plural =
noun.robot.plural =
noun.any.plural =
noun.vehicle =
noun.track =
noun.person =
wrong.force = place track? who?
wrong.skip_identification.warn = place track? who?
wrong.skip_identification.block = place track? who?
wrong.skip_warning.block = place track? who?
wrong.override = clause
wrong.chase = place track who?
wrong.zone = zone who
wrong.noncombatants.identify = place track? who?
wrong.noncombatants.warn = place track? who?
wrong.noncombatants.block = place track? who?
wrong.strip = place
wrong.strip.all =
wrong.unknown_place = who gate_word?
wrong.incapable.drone_warn = who place track?
wrong.incapable.drone_block = who place track?
wrong.incapable.drone_identify = who place track?
wrong.incapable.robot_fly = who place track?
wrong.incapable.vehicle_fly = who place track?
wrong.incapable.robot_block = who place track?
wrong.incapable.vehicle_warn = who place track?
harmless.go = who place
harmless.look = who? place
harmless.identify = who? place
harmless.hold = who
harmless.home = who
harmless.report = who
aside = asset? place? thing?
inject = order asset? gate? base?
inject.only = asset? gate? base?
condition.track_at = place track
condition.no_track_at = place track
condition.authorized = place track
condition.unauthorized = place track
condition.hostile = place track
condition.uncovered = place
condition.covered = place
condition.low = asset
condition.not_low = asset
condition.down = asset
condition.up = asset
condition.free = kind
condition.none_free = kind/kinds
conditional.else = if then else
conditional.nothing = if then
conditional.then = if then
else_nothing =
"""


def _read(listed: str) -> Mapping[str, Slots]:
    pairs = (line.partition("=") for line in listed.strip().splitlines())
    return MappingProxyType({key.strip(): _slots(words) for key, _, words in pairs})


KEYS = _read(_LISTED)
"""Every key that a bank may have, with its slots."""
