"""The boat clock: a monotonic clock, int nanoseconds of CLOCK_BOOTTIME, optionally scaled.

Every time in memory is `t_ns` on this clock, rounded to whole microseconds when stamped.
The wall clock is used for nothing but the UTC a frame is labelled with.
`rate` > 1 makes a whole run (ports, frame grid, back-off, stale limits, virtual boat) go faster;
link timers use the real clock.
"""

import secrets
import time
from pathlib import Path

from common.units import NS_PER_S, NS_PER_US

_BOOT_ID_FILE = Path("/proc/sys/kernel/random/boot_id")


def boottime_ns() -> int:
    """Nanoseconds since the machine started, suspend included (monotonic where BOOTTIME does not exist)."""
    clock = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
    return time.clock_gettime_ns(clock)


def whole_us(t_ns: int) -> int:
    """`t_ns` rounded down to whole microseconds: what a `dt_us` on the wire can carry exactly."""
    return t_ns - t_ns % NS_PER_US


def machine_clock_id() -> str:
    """The kernel's boot id: times of two frames can be compared exactly when this is equal."""
    try:
        return _BOOT_ID_FILE.read_text(encoding="ascii").strip().replace("-", "")
    except OSError:
        return secrets.token_hex(16)


class BoatClock:
    """now = t_start + rate * (boottime - t_start); shell files read it, the core is handed times."""

    def __init__(self, rate: float = 1.0, t_start_ns: int | None = None) -> None:
        """Rate: boat seconds per real second (> 0); t_start_ns: where scaled and real clock agree (boottime)."""
        self.rate = rate
        self.t_start_ns = boottime_ns() if t_start_ns is None else t_start_ns

    def now_ns(self) -> int:
        """Boat time now, whole microseconds."""
        elapsed = boottime_ns() - self.t_start_ns
        return whole_us(self.t_start_ns + (elapsed if self.rate == 1.0 else int(self.rate * elapsed)))

    def seconds_until(self, t_ns: int) -> float:
        """Real seconds to wait until boat time `t_ns`; 0 when it is past."""
        return max(0.0, (t_ns - self.now_ns()) / NS_PER_S / self.rate)
