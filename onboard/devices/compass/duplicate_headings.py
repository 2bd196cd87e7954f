"""Duplicate suppression: one value at an instant, though a device may send the same reading in several sentences."""

from typing import Final

from common.units import NS_PER_S

HOLD_NS: Final = 2 * NS_PER_S
"""Hold time, ns: a source that is silent for longer is no longer the one that is used."""


class OneSource:
    """Chooses the one sentence (talker and formatter) whose values are used; the others repeat the same reading.

    Two sentences of one reading taken as two measurements would make a filter trust the compass too much.

    - The first one heard is the source, until it is silent for 2 s: then whichever comes next is.
    - A sentence of higher rank that comes regularly (within 2 s of its last one) takes over, its next line being the
      first that counts: the reading it repeats now has been given. A rare one does not displace a frequent one.
    """

    def __init__(self) -> None:
        self._source = ""
        self._rank = 0
        self._given_ns: int | None = None
        self._heard_ns: dict[str, int] = {}

    def admits(self, source: str, rank: int, t_ns: int) -> bool:
        """Is the value that `source` brings at `t_ns` to be used? Call it for good values only, in order of time."""
        before_ns = self._heard_ns.get(source)
        self._heard_ns[source] = t_ns
        if not self.covers(source, t_ns):
            self._source, self._rank, self._given_ns = source, rank, t_ns
            return True
        if rank > self._rank and before_ns is not None and t_ns - before_ns <= HOLD_NS:
            self._source, self._rank, self._given_ns = source, rank, t_ns
        return False

    def covers(self, source: str, t_ns: int) -> bool:
        """Whether another source than this one gives the values at `t_ns`."""
        return source != self._source and self._given_ns is not None and t_ns - self._given_ns <= HOLD_NS
