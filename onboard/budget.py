"""Byte budget of one port: what keeps a babbling device from taking the daemon with it.

A bucket that refills at the budget's rate and holds one second of it, so that a whole GPS epoch may come as one burst.
"""

from common.units import NS_PER_S

_BURST_S = 1.0
_LEAST_BURST_BYTES = 4096
"""One full read: a chunk gathered while the board was busy is not a flood."""


class ByteBudget:
    """`take(n, t_ns)` says how many of the next n bytes may be parsed."""

    def __init__(self, bytes_per_s: int) -> None:
        self.bytes_per_s = bytes_per_s
        self._capacity = max(bytes_per_s * _BURST_S, _LEAST_BURST_BYTES)
        self._level = self._capacity
        self._t_ns: int | None = None

    def take(self, count: int, t_ns: int) -> int:
        """Bytes (0..count) allowed of a chunk read at boat time `t_ns`."""
        if self._t_ns is not None:
            self._level += (t_ns - self._t_ns) / NS_PER_S * self.bytes_per_s
            self._level = min(self._level, self._capacity)
        self._t_ns = t_ns
        allowed = min(count, int(self._level))
        self._level -= allowed
        return allowed
