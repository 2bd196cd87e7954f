"""Events of the filters: each once though a rewind finds it again, and floods summed up (rate limit)."""

from collections.abc import Hashable, Mapping
from typing import Final

from common.events import event
from common.messages import Event
from common.units import NS_PER_S

SUMMED_NS: Final = 10 * NS_PER_S
"""Counts of one kind are said at most this often, in boat time."""


class Notices:
    """Gathers events until they are taken."""

    def __init__(self) -> None:
        self._events: list[Event] = []
        self._said: set[Hashable] = set()
        self._counted: dict[tuple[str, str], tuple[int, int]] = {}
        """Count when it was said last, and the boat time (ns) of that, by (code, sensor)."""

    def add(self, happened: Event) -> None:
        """An event that is made elsewhere."""
        self._events.append(happened)

    def say(self, code: str, t_ns: int, source: str = "filter", **evidence: str | float | bool | None) -> None:
        """An event of the table. t_ns: boat time."""
        self._events.append(event(code, t_ns, source, **evidence))

    def once(self, key: Hashable) -> bool:
        """True the first time that this key is asked for."""
        if key in self._said:
            return False
        self._said.add(key)
        return True

    def summed(self, code: str, counts: Mapping[str, int], t_ns: int, **evidence: float) -> None:
        """Say by how much counts have grown: a backfill after a cut of the link is a few events, not thousands.

        counts: sensor -> how many since the start. The event has `sensor` and `count` beside `evidence`.
        """
        for sensor, count in counts.items():
            said, said_ns = self._counted.get((code, sensor), (0, None))
            if count == said or (said_ns is not None and t_ns - said_ns < SUMMED_NS):
                continue
            self._counted[code, sensor] = (count, t_ns)
            self.say(code, t_ns, sensor, sensor=sensor, count=count - said, **evidence)

    def take(self) -> tuple[Event, ...]:
        """All since the last call."""
        taken = tuple(self._events)
        self._events.clear()
        return taken
