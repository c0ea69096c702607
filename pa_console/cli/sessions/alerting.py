"""The alerts of a verb's session by its options: to whom, about what, and when again."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from pa_console.cli.options import SessionOptions, naming_what_is_missing
from pa_console.settings.schema import Settings
from pa_console.station.alerts import Alerting, AlertRules


@dataclass(frozen=True)
class AlertTargets:
    """The addresses for alerts at once, and those for reminders only."""

    now: Sequence[str] = ()
    later: Sequence[str] = ()

    @classmethod
    def of(cls, options: SessionOptions) -> "AlertTargets":
        """Return the addresses of a session's options."""
        return cls(tuple(options.alert or ()), tuple(options.alert_later or ()))

    def __bool__(self) -> bool:
        """Return True if there is any address."""
        return bool(self.now or self.later)


NOBODY = AlertTargets()


@contextmanager
def alerting(targets: AlertTargets, settings: Settings) -> Generator[Alerting]:
    """Yield the alerts about a session; raises ValueError for an address that is none."""
    with naming_what_is_missing("alert", "alerts need"):
        from pa_console.observability.alert_delivery import AlertDelivery, receivers  # noqa: PLC0415

    rules = AlertRules(settings.alert_from, settings.alert_after_min * 60.0)
    delivery = AlertDelivery(receivers(targets.now, targets.later))
    try:
        with Alerting(rules, delivery) as alerts:
            yield alerts
    finally:
        delivery.close()
