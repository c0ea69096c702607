"""When the approval panel takes a decision: not from a key that was meant for something else."""

from collections.abc import Callable

_FREE_KEYS = ("tab", "shift+tab", "escape", "pageup", "pagedown")


class Arming:
    """Whether decisions are taken: it was quiet for long enough, and none was sent yet."""

    def __init__(self, clock: Callable[[], float], delay_s: float) -> None:
        """It has to be quiet for `delay_s` seconds of `clock`."""
        self._clock, self.delay_s = clock, delay_s
        self._quiet_since = 0.0
        self.sent = False
        """Whether a decision about what is shown was sent."""

    def disarm(self) -> None:
        """Begin to wait, because something was typed or has appeared."""
        self._quiet_since = self._clock()

    @property
    def armed(self) -> bool:
        """Whether a decision is taken now."""
        return not self.sent and self._clock() - self._quiet_since >= self.delay_s


def is_free(key: str) -> bool:
    """Whether a key decides nothing wherever the focus is, so that it need not wait."""
    return key in _FREE_KEYS or (key[0] == "f" and key[1:].isdigit())
