"""Link-loss state machine: the loss of the link as the log and a person see it. Pure.

    up --(silent too long: link-lost)--> lost --(a frame: link-restored)--> filling --(none missing: gaps-filled)--> up

A link that is lost again while frames of the first loss are still fetched is lost; `gaps-filled` then comes once.
"""

from common.events import event
from common.messages import Event
from common.units import NS_PER_S


class LinkLoss:
    """Follows the link; a method gives the event that is due, if one is. `now_ns` is the station's monotonic time."""

    def __init__(self) -> None:
        self._since_ns: int | None = None
        self._is_filling = False

    @property
    def is_lost(self) -> bool:
        """True while no frame has come since the link fell silent."""
        return self._since_ns is not None

    def silent(self, silent_s: float, now_ns: int, t_ns: int) -> Event | None:
        """The link has been silent for this time. t_ns: boat time of the newest frame."""
        if self._since_ns is not None:
            return None
        self._since_ns = now_ns - int(silent_s * NS_PER_S)
        self._is_filling = True
        return event("link-lost", t_ns, "link", age_s=round(silent_s, 1))

    def frame(self, now_ns: int, t_ns: int) -> Event | None:
        """A frame came. t_ns: its end."""
        if self._since_ns is None:
            return None
        age_s = round((now_ns - self._since_ns) / NS_PER_S, 1)
        self._since_ns = None
        return event("link-restored", t_ns, "link", age_s=age_s)

    def heard(self, missing: int, received: int, t_ns: int) -> Event | None:
        """The board was heard. missing: frames that are still to come."""
        if not self._is_filling or self._since_ns is not None or missing:
            return None
        self._is_filling = False
        return event("gaps-filled", t_ns, "link", count=received)

    def lost_s(self, now_ns: int) -> float | None:
        """How long the link has been lost, s; `None` = it is not lost."""
        return None if self._since_ns is None else (now_ns - self._since_ns) / NS_PER_S
