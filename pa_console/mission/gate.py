"""The command gate: it sends only commands that a decision allows, and no movement after a stop.

Only the hold of a stop passes to an asset under manual control, because a person drives the asset.
Manual control is taken by an operator at this station, or reported by the asset. A mission that
fails for this reason awaits its assets. Once manual control of all of them has ended, the mission
is queued again, and planned, checked and approved like any other.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from pa_console.fleets.fleet import Fleet
from pa_console.mission.approval import inadmissible, not_unasked, people_needed
from pa_console.mission.execution.manual_control import ManualControl
from pa_console.mission.orders.standing import StandingOrders
from pa_console.mission.rehearse import device_commands
from pa_console.policy.rulebook import Rulebook
from pa_console.schema.command import STILL, DeviceCommand
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Decision
from pa_console.schema.plan import Action
from pa_console.schema.telemetry import Picture
from pa_console.session.log.journal import Journal

if TYPE_CHECKING:
    from pa_console.fleets.station_authority import StationAuthority


STOPPED = "everything is stopped, and nobody has released the stop"
UNDECIDED = "it is part of no approved plan and of no declared way to safety"
Passage = ev.CommandSent | ev.CommandRefused
"""The result for a command at the gate: it was sent or refused."""


class CommandGate:
    """The last check before the link: a command passes only if a decision allows it.

    An approved plan allows each of its commands once. A halted plan allows the way to safety that
    was approved with it. The operator's stop allows a hold for every asset. A command that depends
    on others passes once all of them are verified. The stop is latched: until `release`, only its
    holds and commands that move nothing pass, whatever was approved before. The gate decides by the
    request and its decision, not by the caller.

    No log, no action: a plan's command is written to disk before it is sent, and no such command
    passes while the `journal` cannot be written. A stop and a way to safety do not wait for the
    disk.

    If the rules require several people, a command passes once that many have signed its approval.
    Without an `authority` there are no signatures, and a decision counts as that of one person. A
    decision by one of the standing `orders` counts only while that order is in force, for a mission
    that it started, and for commands that the rules let it give.

    Only the hold of a stop passes to an asset under manual control, because a stop is for every
    asset. Earlier decisions for the asset stay void after manual control has ended.
    """

    def __init__(
        self,
        fleet: Fleet,
        journal: Journal,
        authority: "StationAuthority | None" = None,
        orders: StandingOrders | None = None,
    ) -> None:
        self._fleet, self._journal, self._authority = fleet, journal, authority
        self._standing_orders = orders or StandingOrders()
        self.stopped = False
        """True while the stop is latched."""
        self.manual = ManualControl(fleet.world)
        """The assets under manual control."""
        self._stops = 0
        self._orders: set[DeviceCommand] = set()
        """The commands of the approved plan that have not passed yet."""
        self._holds: set[DeviceCommand] = set()
        """The holds of the stop that have not passed yet."""
        self._stop_holds: frozenset[DeviceCommand] = frozenset()
        """All holds of the stop that is latched."""
        self._plan: frozenset[DeviceCommand] = frozenset()
        self._waits: dict[DeviceCommand, frozenset[int]] = {}
        """The numbers of the actions that each command of the approved plan still waits for."""
        self._safety: tuple[Action, ...] = ()
        self._halted = False
        self._standing: dict[str, DeviceCommand] = {}
        """The latest command of each agent that may be resent."""

    @property
    def refusal(self) -> str:
        """The reason why this station may move no asset at present; '' if it may."""
        return self._authority.refusal if self._authority is not None else ""

    def objection(self, rules: Rulebook) -> str:
        """Return why this station could not send a plan approved under `rules`; '' if it could."""
        if self._authority is None:
            return ""
        return self.refusal or self._authority.objection(rules)

    def needed(self, request: ev.ApprovalRequested, rules: Rulebook) -> dict[str, int]:
        """Return the acts in `request` that need several people, with the number of people."""
        agents = {action.agent for action in (*request.plan.actions, *request.if_halted)}
        fresh = self._authority.fresh(agents) if self._authority is not None else ()
        return people_needed(request, rules.approvals, fresh)

    def signed(
        self, request: ev.ApprovalRequested, decision: Decision, rules: Rulebook
    ) -> Decision:
        """Return `decision` with the signature of the person at this station, if it has keys.

        A decision that was signed at another station keeps its valid signatures. Its signer has
        also acknowledged the warnings and the override that the request requires.
        """
        if self._authority is None or decision.kind != "approve":
            return decision
        if not decision.signatures:
            return self._authority.signed(request, decision, rules)
        valid = self._authority.valid(request, decision, rules)
        update = {
            "signatures": valid,
            "acknowledged": request.acknowledge if valid else (),
            "override_judge": bool(valid) and request.needs_override,
        }
        return decision.model_copy(update=update)

    def inadmissible(
        self, request: ev.ApprovalRequested, decision: Decision, rules: Rulebook
    ) -> str:
        """Return why `decision` cannot be accepted for `request` under `rules`; '' if it can."""
        if problem := self._not_unasked(request, decision, rules):
            return problem
        if self._authority is None or decision.kind != "approve":
            return inadmissible(request, decision, self.needed(request, rules))
        if problem := self.objection(rules):
            return problem
        people = len(self._authority.valid(request, decision, rules))
        if people < 1:
            return "nobody who may approve at this site has signed it"
        return inadmissible(request, decision, self.needed(request, rules), people)

    def _not_unasked(
        self, request: ev.ApprovalRequested, decision: Decision, rules: Rulebook
    ) -> str:
        """Return why a standing order may not make `decision`; '' if it may, or if none made it."""
        name = decision.standing_order
        if not name or decision.kind != "approve":
            return ""
        mission = request.request_id.rpartition(".")[0]
        started = self._standing_orders.starter(mission) == name
        order = self._standing_orders.find(name) if started else None
        needed = request.model_copy(update={"approvals": self.needed(request, rules)})
        return not_unasked(order, needed, rules.unasked)

    def grant(self, request: ev.ApprovalRequested, decision: Decision, rules: Rulebook) -> None:
        """Allow from now on the commands of the approved plan instead of those of the previous one.

        Raises ValueError while everything is stopped, or if `decision` is not an admissible
        approval of `request` by as many people as the `rules` require.
        """
        problem = STOPPED if self.stopped else self.inadmissible(request, decision, rules)
        if not problem and request.standing is not None:
            problem = "a standing order has no plan; each mission that it starts has its own"
        if problem or decision.kind != "approve":
            raise ValueError(problem or f"the plan was not approved: {decision.kind}")
        if self._authority is not None:
            self._authority.grant(request, decision, rules)
        commands = device_commands(request.plan, request.request_id)
        self._plan, self._orders = frozenset(commands), set(commands)
        self._waits = {
            command: frozenset(action.after)
            for command, action in zip(commands, request.plan.actions, strict=True)
        }
        self._safety, self._halted = request.if_halted, False
        for asset in self.manual.assets:
            self._withdraw(asset)

    def verified(self, numbers: Iterable[int]) -> None:
        """Allow the commands that wait only for these actions, which telemetry has verified."""
        shown = frozenset(numbers)
        self._waits = {command: waits - shown for command, waits in self._waits.items()}

    def halt(self) -> None:
        """Allow no more commands of the plan except its approved way to safety."""
        standing = self._standing.items()
        self._standing = {agent: last for agent, last in standing if last not in self._plan}
        self._orders.clear()
        self._halted = True

    def finish(self) -> None:
        """Allow no more commands of the plan, because it has ended."""
        self._orders.clear()
        self._safety = ()

    def stop_all(self) -> tuple[DeviceCommand, ...]:
        """Latch the stop and return its holds, one per asset; no movement passes from now on."""
        self.stopped = True
        self._stops += 1
        self.finish()
        self._standing.clear()
        holds = tuple(
            DeviceCommand(command_id=f"stop{self._stops}.{number}", agent=name, verb="hold")
            for number, name in enumerate(self._fleet.world.assets, start=1)
        )
        self._holds, self._stop_holds = set(holds), frozenset(holds)
        return holds

    def resume(self, stops: int, *, stopped: bool) -> None:
        """Continue a session that has had `stops` stops; if `stopped`, the last is still latched.

        A device ignores a command id that it has already seen, so the ids continue from `stops`.
        """
        self._stops, self.stopped = stops, stopped

    def release(self) -> None:
        """Release the stop, so that later decisions pass; raises ValueError without a stop."""
        if not self.stopped:
            raise ValueError("nothing is stopped")
        self.stopped, self._stop_holds = False, frozenset()

    def take_manual(self, asset: str, by: str) -> None:
        """Refuse commands to `asset` from now on, because the person `by` drives it.

        Raises ValueError if manual control of the asset cannot be taken. This works without a log,
        because it only keeps commands back.
        """
        self.manual.take(asset, by)
        self._withdraw(asset)
        self._fleet.mark_manual(frozenset(self.manual.taken))

    def end_manual(self, asset: str) -> None:
        """End manual control of `asset`, so that later decisions about it pass.

        Raises ValueError if manual control was not taken at this station, or while the log cannot
        be written.
        """
        if problem := self._journal.commit():
            raise ValueError(f"{asset} stays under manual control: {problem}")
        self.manual.end(asset)
        self._fleet.mark_manual(frozenset(self.manual.taken))

    def see(self, picture: Picture) -> None:
        """Withdraw decisions for the assets that newly report manual control in `picture`."""
        for asset in self.manual.see(picture):
            self._withdraw(asset)

    def _withdraw(self, asset: str) -> None:
        """Withdraw every decision for `asset`, except the hold of a stop."""
        self._orders.difference_update([order for order in self._orders if order.agent == asset])
        self._safety = tuple(action for action in self._safety if action.agent != asset)
        last = self._standing.get(asset)
        if last is not None and last not in self._stop_holds:
            del self._standing[asset]

    def send(
        self, commands: Sequence[DeviceCommand], emit: Callable[[Passage], object]
    ) -> tuple[Passage, ...]:
        """Send the allowed `commands`; emit and return the result for each command.

        Commands that move nothing, and those of a way to safety, are sent at once and logged
        afterwards. The others are sent only if no command is refused, and only after they have
        been written to the log on disk.
        """
        passages: list[Passage] = []
        logged_first: list[DeviceCommand] = []
        refused = False
        for command in commands:
            if why := self._refusal(command):
                refused = True
                passages.append(ev.CommandRefused(command=command, reason=why))
                continue
            self._orders.discard(command)
            self._holds.discard(command)
            if self._waits_for_log(command):
                logged_first.append(command)
            else:
                self._standing[command.agent] = command
                self._fleet.send(command)
                passages.append(ev.CommandSent(command=command))
        if not refused:
            passages += [ev.CommandSent(command=command) for command in logged_first]
        for passage in passages:
            emit(passage)
        if refused or not logged_first:
            return tuple(passages)
        if problem := self._journal.commit():
            held = [ev.CommandRefused(command=command, reason=problem) for command in logged_first]
            for passage in held:
                emit(passage)
            return (*passages, *held)
        for command in logged_first:
            self._standing[command.agent] = command
            self._fleet.send(command)
        return tuple(passages)

    def _waits_for_log(self, command: DeviceCommand) -> bool:
        """Return whether `command` moves an asset for a plan, so that it waits for the log."""
        return command.verb not in STILL and not (self._halted and self._is_safety(command))

    def resend(self, command: DeviceCommand, times: int) -> ev.CommandResent | None:
        """Resend an unanswered command for the `times`-th time.

        Returns None and sends nothing if the command is no longer valid: its device has a newer
        command or is under manual control, its plan was halted, everything was stopped, or another
        station is in command. A plan's movement is also not resent while the log cannot be written.
        """
        if self._standing.get(command.agent) != command or self._unauthorized(command):
            return None
        if self._kept_for_hand(command):
            return None
        if self._journal.problem and self._waits_for_log(command):
            return None
        self._fleet.send(command)
        return ev.CommandResent(command_id=command.command_id, times=times)

    def _refusal(self, command: DeviceCommand) -> str:
        """Return why `command` may not pass; '' if it may."""
        if self.stopped and command.verb not in STILL:
            return STOPPED
        if problem := self._unauthorized(command) or self._kept_for_hand(command):
            return problem
        safety = self._halted and self._is_safety(command)
        if command in self._holds or safety:
            return ""
        if banned := self._banned(command):
            return banned
        if command in self._orders:
            if waits := self._waits.get(command):
                noun = "action" if len(waits) == 1 else "actions"
                return f"it waits for {noun} {', '.join(map(str, sorted(waits)))}, not verified"
            return "" if command.verb in STILL else self._journal.problem
        return STOPPED if self.stopped else UNDECIDED

    def _banned(self, command: DeviceCommand) -> str:
        """Return the standing order, in words, that bans the movement of `command`; '' for none."""
        base = self._fleet.world.base
        goal = base if command.verb == "return_to_base" else command.target or ""
        order = self._standing_orders.banned_by(command.agent, goal)
        return "" if order is None else f"standing order {order.id}: {order.order}"

    def _kept_for_hand(self, command: DeviceCommand) -> str:
        """Return why manual control bars `command`; '' if it does not, as for a stop's hold."""
        return "" if command in self._stop_holds else self.manual.refusal(command.agent)

    def _unauthorized(self, command: DeviceCommand) -> str:
        """Return why this station may not send `command` at present; it may always send a hold."""
        if self._authority is None or command.verb == "hold":
            return ""
        return self._authority.refusal

    def _is_safety(self, command: DeviceCommand) -> bool:
        """Return whether `command` is its agent's approved way to safety, or a hold instead."""
        declared = {(a.verb, a.target) for a in self._safety if a.agent == command.agent}
        return bool(declared) and (command.verb, command.target) in {*declared, ("hold", None)}
