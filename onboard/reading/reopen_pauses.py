"""Retry with exponential backoff: when the open port of a silent sensor is closed and opened once more. Pure.

The first attempt comes with the limit of silence, each one after it when twice as long has passed. An opening resets an
Arduino, which needs seconds to boot and would never come up if the pauses did not grow.
"""

from typing import Final

from common.units import NS_PER_S

LONGEST_NS: Final = 60 * NS_PER_S
"""Longest pause, ns, unless the sensor's own limit is longer."""
_DOUBLINGS: Final = 8


class ReopenPauses:
    """The attempts during one silence."""

    def __init__(self, since_ns: int) -> None:
        self._since_ns = since_ns
        self._attempts = 0

    def restart(self, t_ns: int) -> None:
        """The port was opened or lost at boat time `t_ns`: the next pause is the first again."""
        self._since_ns, self._attempts = t_ns, 0

    def attempted(self, t_ns: int) -> None:
        """The port is being closed and opened because of the silence, which goes on."""
        self._since_ns = t_ns
        self._attempts += 1

    def succeeded(self) -> None:
        """Good lines came: the next pause is the first again."""
        self._attempts = 0

    def is_due(self, now_ns: int, last_good_ns: int | None, limit_ns: int) -> bool:
        """True when one more attempt is due; limit_ns: the first pause."""
        pause_ns = min(limit_ns << min(self._attempts, _DOUBLINGS), max(limit_ns, LONGEST_NS))
        return now_ns - max(self._since_ns, last_good_ns or 0) > pause_ns
