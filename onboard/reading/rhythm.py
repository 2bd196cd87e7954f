"""Rate and period of a sensor's lines: a moving average of measurements, and the learned period. Pure."""

from collections import deque
from typing import Final

from common.units import NS_PER_S

REPORT_NS: Final = NS_PER_S
RATE_WINDOW_REPORTS: Final = 5
BEAT_NS: Final = 3 * NS_PER_S // 5
"""Lines closer together than this are one beat, ns: five of them are within the least limit of 3 s."""
_BEATS: Final = 8
_LONGEST_PERIOD_NS: Final = 60 * NS_PER_S
"""Longest period, ns: a longer gap is an outage, unless the configuration says so."""


class Rate:
    """Rate of measurements over the last reports, Hz."""

    def __init__(self, started_ns: int) -> None:
        self._count = 0
        self._marks = deque([(started_ns, 0)], maxlen=RATE_WINDOW_REPORTS + 1)
        """Time (ns) and number of measurements until then, at each of the last reports."""

    def count(self, measurements: int = 1) -> None:
        """Count some more measurements."""
        self._count += measurements

    def report_hz(self, now_ns: int) -> float:
        """The rate at a report, which becomes a mark of the window when a second has passed since the last one."""
        begin_ns, before = self._marks[0]
        span_ns = max(now_ns - begin_ns, NS_PER_S)
        if now_ns - self._marks[-1][0] >= REPORT_NS:
            self._marks.append((now_ns, self._count))
        return (self._count - before) / (span_ns / NS_PER_S)


class Rhythm:
    """Learns the period of lines that come in bursts: the mean distance of the last beats."""

    def __init__(self, longest_ns: int) -> None:
        self._longest_ns = max(longest_ns, _LONGEST_PERIOD_NS)
        self._beats: deque[int] = deque(maxlen=_BEATS + 1)
        self._last_ns: int | None = None

    def line(self, t_ns: int) -> None:
        """Take the time of a good line."""
        last_ns = self._last_ns
        if last_ns is not None and 0 <= t_ns - last_ns < BEAT_NS:
            return
        if last_ns is not None and not 0 <= t_ns - last_ns <= self._longest_ns:
            self._beats.clear()
        self._beats.append(t_ns)
        self._last_ns = t_ns

    def forget(self) -> None:
        """Forget the period: what comes from here on may be another device."""
        self._beats.clear()
        self._last_ns = None

    @property
    def period_ns(self) -> int | None:
        """Mean distance of the beats, ns; `None` before the second."""
        if len(self._beats) < 2:
            return None
        return (self._beats[-1] - self._beats[0]) // (len(self._beats) - 1)
