"""Token bucket of one port: a rate limit of its bytes, so that a babbling device does not take the daemon with it.

The bucket refills at the budget's rate and holds one second of it, so that a whole GPS epoch may come as one burst.
"""

from common.units import NS_PER_S

_BURST_S = 1.0
_LEAST_BURST_BYTES = 4096
"""Least size of the bucket, bytes: one full read, since a chunk gathered while the board was busy is no flood."""
_CALM_SHARE = 0.75
_GRANT_BYTES = 1024
"""Bytes that an empty bucket gathers before it gives any: in single bytes no line would ever come through whole."""


class ByteBudget:
    """`take(n, t_ns)` says how many of the next n bytes may be parsed."""

    def __init__(self, bytes_per_s: int) -> None:
        self.bytes_per_s = bytes_per_s
        self._capacity = max(bytes_per_s * _BURST_S, _LEAST_BURST_BYTES)
        self._level = self._capacity
        self._empty = False
        self._t_ns: int | None = None

    def take(self, count: int, t_ns: int) -> int:
        """Bytes (0..count) allowed of a chunk read at boat time `t_ns`."""
        level = self._at(t_ns)
        self._t_ns = t_ns
        self._empty = self._empty and level < _GRANT_BYTES
        allowed = 0 if self._empty else min(count, int(level))
        self._empty = self._empty or allowed < count
        self._level = level - allowed
        return allowed

    def calm(self, t_ns: int) -> bool:
        """Is the bucket nearly full again? Not while a device is just above its budget and is cut now and then."""
        return self._at(t_ns) >= _CALM_SHARE * self._capacity

    def _at(self, t_ns: int) -> float:
        if self._t_ns is None or t_ns <= self._t_ns:
            return self._level
        return min(self._level + (t_ns - self._t_ns) / NS_PER_S * self.bytes_per_s, self._capacity)
