"""The situation in which a later step is planned: as the rehearsals of those before leave it."""

from dataclasses import replace

from pa_console.fleets.foreseen import ForeseenFleet
from pa_console.mission.context import MissionContext, PastOrders, ordered_by
from pa_console.mission.examine import Examination
from pa_console.schema.mission import Mission


class ForeseenContext:
    """Gives each step the context of its turn, and takes in how it goes."""

    def __init__(self, context: MissionContext) -> None:
        self._context, self._services, self._monitor = context, context.services, context.monitor

    def begin(self, words: str) -> MissionContext:
        """Return the context for a step with these words."""
        mission = self._context.mission.model_copy(update={"text": words, "typed": ""})
        return replace(
            self._context, services=self._services, mission=mission, monitor=self._monitor
        )

    def end(self, step: MissionContext) -> None:
        """Count on from the plans of a step."""
        self._context.attempts = step.attempts

    def went(self, found: Examination, mission: Mission) -> bool:
        """Take in how a step goes; False where it is blocked, so that nothing follows it."""
        rehearsal, world = found.rehearsal, self._services.fleet.world
        if found.blocked or rehearsal is None:
            return False
        before, past = self._services.fleet.picture(), self._services.past
        past = PastOrders([*past.missions], past.pointer)
        spoken = mission.model_copy(update={"source": "operator"})
        past.remember(spoken, ordered_by(found.plan, before), undid=False, corrects=False)
        fleet = ForeseenFleet(world, rehearsal.after)
        self._services = replace(self._services, fleet=fleet, past=past)
        self._monitor = self._monitor.copy()
        for moment in rehearsal.moments:
            self._monitor.observe(moment)
        return True
