"""Work for a mission before it is submitted: reading ahead of prompts, and drafts while typing.

The model reads ahead the fixed parts of prompts and the current picture. While a mission is typed,
it also reads the words so far and the rules that concern them. The second reader is started when
the first words are typed, and reads them after the planner and the judge. If a plan is carried out
and its workflow continues, the picture at the end of the plan's rehearsal is read for the next
plan.

During a pause in typing, a draft of the mission goes through the same steps as a submitted mission,
up to its approval. The events of the draft are not logged, it sends no commands, and no other front
end or station receives it. The answers of the models are kept (`llm.early_answers`). When the same
order is submitted, its mission repeats every step, but the kept answer is used for each equal
prompt.
"""

import asyncio
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from typing import NamedTuple, NoReturn

from pa_console.language.references.conversation import Unclear
from pa_console.language.references.resolution import resolve
from pa_console.llm.backend import EngineError
from pa_console.llm.local.engine import SessionEngine
from pa_console.llm.local.threads import NEARLY, idle_seconds
from pa_console.llm.roles.clause_reader import ClauseReader, reading_prefix
from pa_console.mission.context import Services
from pa_console.mission.execution.dispatch import StepFeed
from pa_console.mission.planning.picture_text import digest_picture, is_small
from pa_console.mission.run import MissionRun, StationSide
from pa_console.mission.spelling import prepare, read_words
from pa_console.mission.verify import OutcomeVerdicts
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.events import event as ev
from pa_console.schema.events.event import Role
from pa_console.schema.mission import MAX_MISSION_TEXT, Decision, Mission
from pa_console.schema.rehearsal import Rehearsal
from pa_console.schema.telemetry import Digest, Picture
from pa_console.session.mission_fold import apply_to_mission
from pa_console.session.mission_trace import MissionTrace
from pa_console.station.intake import ReadText
from pa_console.views.waiting import reading_line

PAUSE_S = 0.3
"""The time without a key press after which an order is read, in seconds."""

ENDS = (".", "!", "?")
"""The characters that end an order; after one of them, the order is read without a pause."""

LEAST_WORDS = 3
"""The least number of words that are read, because a shorter text is hardly an order yet."""

DRAFT = "draft"
"""The id of a mission that is a draft."""

_MEASURED = re.compile(r"\b\d+ [ms]\b")

ShowReading = Callable[[str, str], None]
"""A function that gets a text and its live reading to show; two empty strings remove it."""
ROLES: tuple[Role, ...] = ("planner", "judge", "outcome")
TYPING_ROLES: tuple[Role, ...] = ("planner", "judge")


class _Situation(NamedTuple):
    """All that the reading of an order depends on, except its words."""

    rulebook: Rulebook
    digest: Digest
    """The picture as prompts have it, but without metres and seconds, which change constantly."""
    past: int
    pointer: str


class _DraftReadError(Exception):
    """Raised to end a draft at the point where a mission would wait for its operator."""


class LiveReading:
    """The live reading of the order that is being typed; submitted work goes first."""

    def __init__(
        self,
        services: Callable[[], Services],
        read: Callable[[str], ReadText | None],
        free: Callable[[], bool],
    ) -> None:
        """Read texts with `read`, which returns None for a text that is not a mission.

        `free` returns True if no mission needs the models.
        """
        self._services, self._read_text, self._free = services, read, free
        self._show: ShowReading | None = None
        self._text = ""
        self._read_in: _Situation | None = None
        """The situation in which the text was or is being read."""
        self._shown = False
        self._timer: asyncio.TimerHandle | None = None
        self._draft: asyncio.Task[None] | None = None
        self._idle_s: float | None = None

    def show_in(self, show: ShowReading | None) -> None:
        """Pass live readings to `show` from now on; None stops live reading."""
        self._stop()
        self._show = show

    def typing(self, text: str) -> None:
        """Record the text in the input field; the reading of an earlier text is removed."""
        words = " ".join(text.split())
        if words != self._text:
            self._stop()
            self._text = words
            self._wait()

    def see(self, payload: ev.EventPayload) -> None:
        """Stop if an event needs the models; read again if the situation has changed."""
        if not self._text:
            return
        match payload:
            case ev.MissionReceived(mission=mission) if mission.said == self._text:
                # Keep the answers that the models are writing, because the mission needs them next.
                self._stop(answers=False)
                self._text = ""
            case ev.MissionReceived() | ev.AllStopped() | ev.RulesReplaced() | ev.CommandTaken():
                self._stop()
            case ev.TelemetryReceived() if self._show is not None:
                if self._timer is None and self._read_in != self._situation():
                    self._stop()
                    self._wait()
            case _:
                pass

    def give_way(self) -> None:
        """Stop reading, because the models or the cores are needed."""
        self._stop()

    def close(self) -> None:
        """Stop reading for the rest of the session."""
        self._stop()
        self._show = None

    def _stop(self, *, answers: bool = True) -> None:
        """Remove the reading and end the draft; if `answers`, also stop the models' answers."""
        if self._timer is not None:
            self._timer.cancel()
        if self._draft is not None:
            self._draft.cancel()
        self._timer = self._draft = self._read_in = None
        if answers:
            self._services().early.stop()
        if self._shown and self._show is not None:
            self._show("", "")
        self._shown = False

    def _wait(self) -> None:
        """Read the text after a pause in typing; read a complete sentence at once."""
        if self._show is None or len(self._text.split()) < LEAST_WORDS:
            return
        slow = self._services().engine.state == "slow"
        self._idle_s = idle_seconds() if slow else None
        # On a slow machine, the pause is long enough to measure whether a core is idle.
        pause_s = 0.0 if self._text.endswith(ENDS) and not slow else PAUSE_S
        self._timer = asyncio.get_running_loop().call_later(pause_s, self._begin)

    def _begin(self) -> None:
        """Begin a draft if models and cores are free; if not, it is tried at a later picture."""
        self._timer = None
        services = self._services()
        if self._free() and not services.servers.by_use and self._has_cores(services.engine):
            self._read_in = self._situation()
            self._draft = asyncio.create_task(self._read(self._text), name="live reading")

    def _has_cores(self, engine: SessionEngine) -> bool:
        """Return whether the models are not slow, or a core was idle during the pause in typing."""
        if engine.state != "slow":
            return True
        idle_s = idle_seconds()
        if idle_s is None or self._idle_s is None:
            return False
        return idle_s - self._idle_s >= NEARLY * PAUSE_S

    def _situation(self) -> _Situation:
        services = self._services()
        digest, past = digest_picture(services.fleet.picture(), services.fleet.world), services.past
        lines = {"tracks": _unmeasured(digest.tracks), "unknown": _unmeasured(digest.unknown)}
        digest = digest.model_copy(update=lines)
        return _Situation(services.rulebook, digest, len(past.missions), past.pointer)

    async def _read(self, text: str) -> None:
        """Plan `text` like a mission and show its reading."""
        try:
            line = await self.line(text)
        except Exception:  # a defect is reported when the order is submitted
            line = ""
        if line and self._show is not None:
            self._shown = True
            self._show(text, line)

    async def line(self, text: str) -> str:
        """Return the live reading of `text`, with the plan; '' if it is not a mission."""
        order = self._read_text(text)
        return await self._line(order) if order is not None else ""

    async def _line(self, order: ReadText) -> str:
        services = self._services()
        right = order.text[:MAX_MISSION_TEXT]
        typed = order.typed if order.typed != right else ""
        mission = Mission(id=DRAFT, text=right, typed=typed, created=datetime.now(UTC))
        trace = MissionTrace(mission)
        draft = MissionRun(
            services.for_draft(),
            mission,
            partial(apply_to_mission, trace),
            StationSide(StepFeed(), _not_decided, _no_verdicts(), lambda: ()),
        )
        with suppress(_DraftReadError):
            await draft.work()
        return reading_line(trace, services.fleet.world.base)


def _unmeasured(lines: Iterable[str]) -> tuple[str, ...]:
    return tuple(_MEASURED.sub("", line) for line in lines)


async def _not_decided() -> Decision:
    raise _DraftReadError


def _no_verdicts() -> OutcomeVerdicts:
    """Return outcome verdicts for a draft, which is never carried out."""

    def start(_: object) -> NoReturn:
        raise _DraftReadError

    return OutcomeVerdicts(start, between_missions=False)


class ReadAhead:
    """The reading ahead of prompts, which a prompt that a caller waits for interrupts."""

    def __init__(self, services: Services, *, unasked: bool = True) -> None:
        """Read ahead for `services`; if `unasked`, also while no order is typed.

        These times are the start of a session, the time between missions, and the execution of a
        plan.
        """
        self._services, self._unasked = services, unasked
        self._read: dict[tuple[SessionEngine, Role], tuple[Digest | None, str]] = {}
        self._typed = ""
        self._rehearsals: dict[int, Rehearsal] = {}
        """The rehearsals of the mission's plans, by the number of the attempt."""
        self._foreseen: Picture | None = None
        self._wanted = asyncio.Event()
        self._turn = asyncio.Lock()

    def use(self, services: Services) -> None:
        """Use `services` from now on; all prompts must then be read again."""
        self._services = services
        self._read.clear()

    async def load(self) -> None:
        """Load model, dictionary and patterns; if `unasked`, read the beginnings of prompts."""
        async with self._turn:
            with suppress(EngineError):  # the engine's state and the next prompt report it
                await self._services.engine.start()
                await asyncio.to_thread(prepare)
                await asyncio.to_thread(self._services.rulebook.prepare)
                for role in ROLES if self._unasked else ():
                    await self._warm(self._services.engine, role)

    def typing(self, text: str) -> None:
        """Record the text of the mission that is being typed."""
        self._typed = text
        self._wanted.set()

    def see(self, payload: ev.EventPayload) -> None:
        """Let the model read the picture that is expected for a mission's next plan.

        A next plan is expected if an approved plan leaves a contact identified but not warned. The
        expected picture is the one at the end of the rehearsal.
        """
        match payload:
            case ev.MissionStarted():
                self._rehearsals.clear()
            case ev.PlanRehearsed(attempt=attempt, rehearsal=rehearsal):
                self._rehearsals[attempt] = rehearsal
            case ev.DecisionMade(accepted=True, attempt=attempt, decision=decision):
                approved = self._rehearsals.get(attempt) if decision.kind == "approve" else None
                tracks = approved.timeline.tracks.values() if approved is not None else ()
                due = any(t.identified_s is not None and t.warned_s is None for t in tracks)
                if approved is not None and due and self._unasked:
                    self._foreseen = approved.after
                    self._wanted.set()
            case _:
                pass

    async def serve(self) -> None:
        """Read the typed text or the expected picture at each change, until cancelled."""
        while True:
            await self._wanted.wait()
            self._wanted.clear()
            foreseen, self._foreseen = self._foreseen, None
            if foreseen is None:
                await self.read_now(self._typed)
            elif self._services.engine.state != "slow":
                async with self._turn:
                    for role in TYPING_ROLES:
                        await self._warm(self._services.engine, role, picture=foreseen)

    async def read_now(self, text: str = "") -> None:
        """Read the current picture and all of `text` but its last word, which may be incomplete.

        For a mission that begins with this text, this part of the prompt is then already read.
        """
        async with self._turn:
            services = self._services
            scene = services.scene
            read = read_words(text.rpartition(" ")[0], scene.world, services.rulebook)
            resolution = resolve(scene, read, {})
            read = read if isinstance(resolution, Unclear) else resolution.text
            for role in TYPING_ROLES:
                await self._warm(services.engine, role, read)
            second = services.engine.second_reader
            if second is not None and services.variant.read_again:
                await self._warm(second, "judge", read)

    async def _warm(
        self, engine: SessionEngine, role: Role, words: str = "", picture: Picture | None = None
    ) -> None:
        """Let `engine` read the beginning of a prompt for `role`, unless it was already read.

        `picture` is by default the current one. In a large world, no picture is read, because it
        depends on the mission which part of the picture is in the prompt.
        """
        services = self._services
        fleet = services.fleet
        whole = is_small(fleet.world)
        digest = digest_picture(picture or fleet.picture(), fleet.world) if whole else None
        if services.engine.busy or self._read.get((engine, role)) == (digest, words):
            return
        self._read[engine, role] = (digest, words)
        if isinstance(services.second_reader, ClauseReader) and engine is not services.engine:
            prompt = reading_prefix(fleet.world, digest)
            await engine.warm(role, prompt.system, prompt.user)
            return
        prompt = services.prompt_format.ahead(role, fleet.world, digest)
        if services.prompt_format.typed is not None and digest is not None and words.strip():
            hits = services.retriever.retrieve(words, services.top_k)
            rules = [services.rulebook.get(hit.rule_id) for hit in hits]
            prompt = services.prompt_format.typed(role, fleet.world, digest, rules, words)
        await engine.warm(role, prompt.system, prompt.user)
