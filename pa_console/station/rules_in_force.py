"""The rules in force, which are loaded again when their file changes.

An invalid file changes nothing. If the new rules are weaker than the earlier ones, they take effect
only after the operator accepts them.
"""

import asyncio
import os
from collections.abc import Iterator
from pathlib import Path

from pa_console.mission.context import Services
from pa_console.policy.authoring.differences import compare_rules
from pa_console.policy.expressions.deadlines import DEADLINE_S
from pa_console.policy.pinned_rules import RulesPins, downgrade, pin_of
from pa_console.policy.rule_seal import refuse_altered, signature_path
from pa_console.policy.rulebook import Rulebook, load_rules, with_core
from pa_console.schema.document import DocumentError
from pa_console.schema.events import event as ev
from pa_console.schema.rule import SHORT, RuleSet
from pa_console.signing import SigningError
from pa_console.station.live_reading import ReadAhead
from pa_console.station.worker import EmitFor, MissionWorker

Stamp = tuple[tuple[int, int, int] | None, ...]
LOOK_S = 1.0
"""The interval between two checks of the file for changes, in seconds of wall time."""
MOST_NAMED = 4


class RulesWatch:
    """A watch on the rule file and its signature for changes since the last load."""

    def __init__(
        self,
        path: Path,
        *,
        unsigned: bool = False,
        pins: RulesPins | None = None,
        deadline_s: float = DEADLINE_S,
    ) -> None:
        """Watch the file at `path`, which has just been loaded.

        With `unsigned`, a signed rule set that was altered is loaded too. Without `pins`, a rule
        set is compared only with the one in force, and its seal is not stored.
        """
        self.path = path
        self._unsigned, self._pins, self._deadline_s = unsigned, pins, deadline_s
        self._loaded = self._seen = self._stamp()

    def look(self) -> bool:
        """Return whether the file differs from the loaded version and has stopped changing."""
        now = self._stamp()
        before, self._seen = self._seen, now
        return now == before and now != self._loaded

    async def load(self) -> Rulebook:
        """Load the rules from the file in a thread, and return them.

        Raises ValueError with file, place and problem if they cannot be put in force.
        """
        self._loaded = self._stamp()
        return await asyncio.to_thread(self._load)

    def refusal(self, old: Rulebook, new: Rulebook) -> str:
        """Return why the rules `new` are weaker than the earlier rules; '' if they are accepted.

        Raises RefusedRulesError if this cannot be determined.
        """
        if self._unsigned and new.seal.altered:
            return ""
        if self._pins is not None:
            return self._pins.refusal(new.name, new.seal)
        return downgrade(pin_of(old.name, old.seal), pin_of(new.name, new.seal))

    def admit(self, new: Rulebook, why: str) -> Rulebook:
        """Pin the rules `new`, and return them with the core rules, ready to be put in force.

        `why` is the reason why the operator had to accept them; '' if acceptance was not needed.
        Raises RefusedRulesError if they are refused, and OSError if they cannot be pinned.
        """
        seal = new.seal.model_copy(update={"accepted": why})
        if self._pins is not None:
            accept = bool(why) or (self._unsigned and new.seal.altered)
            seal = self._pins.admit(new.name, new.seal, accept=accept)
        return with_core(new.sealed(seal), self._deadline_s)

    def _load(self) -> Rulebook:
        try:
            rulebook = load_rules(self.path, self._deadline_s)
            if not self._unsigned:
                refuse_altered(self.path, rulebook.seal)
        except (DocumentError, SigningError, OSError) as error:
            raise ValueError(str(error)) from error
        return rulebook

    def _stamp(self) -> Stamp:
        return tuple(_stamp(path) for path in (self.path, signature_path(self.path)))


def _stamp(path: Path) -> tuple[int, int, int] | None:
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_ino, status.st_size, status.st_mtime_ns


class RulesReload:
    """The reload of changed rules, which emits every change and every refusal."""

    def __init__(
        self,
        services: Services,
        watch: RulesWatch | None,
        emit: EmitFor,
        worker: MissionWorker,
        ahead: ReadAhead,
    ) -> None:
        """Reload the rules when `watch` reports a change; without `watch`, never reload them."""
        self._services, self._watch, self._emit = services, watch, emit
        self._worker, self._ahead = worker, ahead
        self._turn = asyncio.Lock()
        self._offered: Rulebook | None = None
        self.offered = ""
        """The reason why the rules in the file need the operator's acceptance; '' if they do not.
        """

    @property
    def services(self) -> Services:
        """The services for new missions."""
        return self._services

    async def serve(self) -> None:
        """Load the rules after every change of the file, until cancelled."""
        while self._watch is not None:
            await asyncio.sleep(LOOK_S)
            if self._watch.look():
                await self.now()

    async def now(self) -> None:
        """Load the rules from the file now."""
        if self._watch is None:
            return
        async with self._turn:
            self._offered, self.offered = None, ""
            try:
                rulebook = await self._watch.load()
                why = self._watch.refusal(self._services.rulebook, rulebook)
            except ValueError as error:
                self._not_taken(str(error))
                return
            if why:
                self._offered, self.offered = rulebook, why
                self._not_taken(f"{why}. You can accept them in the policy browser")
            else:
                await self._take(rulebook, "")

    async def accept(self) -> None:
        """Accept the rules that wait, and put them in force; raises ValueError if no rules wait."""
        async with self._turn:
            rulebook, why = self._offered, self.offered
            if rulebook is None:
                raise ValueError("no changed rules wait to be accepted")
            self._offered, self.offered = None, ""
            await self._take(rulebook, why)

    def _not_taken(self, problem: str) -> None:
        old = self._services.rulebook
        kept = f"{old.name} {old.seal.content_sha256[:SHORT]} stays in force"
        self._tell("alarm", f"the changed rules were not accepted, {kept}: {problem}")

    async def _take(self, rulebook: Rulebook, why: str) -> None:
        """Put `rulebook` in force; the session continues while the rules are indexed.

        `why` is the reason why the operator had to accept the rules; '' if acceptance was not
        needed.
        """
        old = self._services.rulebook
        before, after = old.rule_set, rulebook.rule_set
        if self._watch is None or before is None or after is None:
            return
        try:
            rulebook = self._watch.admit(rulebook, why)
        except (ValueError, OSError) as error:
            self._not_taken(str(error))
            return
        if rulebook.seal == old.seal:
            return
        self._services = await asyncio.to_thread(self._services.with_rules, rulebook)
        self._worker.use(self._services)
        self._ahead.use(self._services)
        changes = tuple(_changes(before, after))
        self._emit(
            ev.RulesReplaced(
                rules=rulebook.name,
                rules_sha256=rulebook.sha256,
                rules_seal=rulebook.seal,
                changes=changes,
                rule_set=after,
            ),
            None,
        )
        level: ev.Level = "alarm" if rulebook.seal.warnings else "warning"
        self._tell(level, _in_words(rulebook, changes, self._worker.worked_on))

    def _tell(self, level: ev.Level, text: str) -> None:
        self._emit(ev.Noticed(level=level, subject="rules", text=text), None)


def _changes(before: RuleSet, after: RuleSet) -> Iterator[str]:
    """Yield the differences rule by rule, such as `ROE-02 changed`."""
    for change in compare_rules(before, after):
        yield f"{change.id or 'the rule set itself'} {change.kind}"


def _in_words(rulebook: Rulebook, changes: tuple[str, ...], worked_on: str) -> str:
    named = ", ".join(changes[:MOST_NAMED]) or "no rule changed"
    more = f" and {len(changes) - MOST_NAMED} more" if len(changes) > MOST_NAMED else ""
    standing = "; ".join((rulebook.seal.words, *rulebook.seal.warnings))
    pinned = f"; {worked_on} continues under its earlier rules" if worked_on else ""
    return f"now in force: {rulebook.name} {rulebook.seal.title}, {standing}: {named}{more}{pinned}"
