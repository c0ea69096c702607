"""A rate limit for clients: a token bucket each."""

from collections import OrderedDict
from collections.abc import Callable
from math import ceil
from time import monotonic

MOST_BUCKETS = 1024


class Rate:
    """Lets each name have `burst` requests at once, and `per_s` a second after that."""

    def __init__(self, per_s: float, burst: int, clock: Callable[[], float] = monotonic) -> None:
        self._per_s, self._burst, self._clock = per_s, burst, clock
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, name: str) -> int:
        """Take one request of `name`; return 0, or after how many seconds there is one again."""
        now = self._clock()
        left, since = self._buckets.pop(name, (float(self._burst), now))
        left = min(self._burst, left + (now - since) * self._per_s)
        wait = 0 if left >= 1.0 else ceil((1.0 - left) / self._per_s)
        self._buckets[name] = (left - 1.0 if left >= 1.0 else left, now)
        while len(self._buckets) > MOST_BUCKETS:
            self._buckets.popitem(last=False)
        return wait
