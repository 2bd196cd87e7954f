"""Sessions of the link: who is served, over which connection and until when; rate limit (token bucket). Pure.

What a client is sent next is `onboard.link.send_order`.
"""

from dataclasses import dataclass, field
from typing import Final

from common.link_messages import LEASE_S, Lease
from common.units import NS_PER_S
from onboard.link.bounded_run import InOrder
from onboard.link.send_order import SendOrder

LEASE_NS: Final = int(LEASE_S * NS_PER_S)


class Pace:
    """Token bucket, for events and work that a client causes: so many at once, then so many a second."""

    def __init__(self, at_once: int, per_s: float) -> None:
        self._at_once = at_once
        self._per_s = per_s
        self._left = float(at_once)
        self._t_ns = 0

    def allows(self, t_ns: int) -> bool:
        """Whether one more may be at `t_ns`; it counts then."""
        self._left = min(self._at_once, self._left + max(0, t_ns - self._t_ns) / NS_PER_S * self._per_s)
        self._t_ns = max(t_ns, self._t_ns)
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


@dataclass(slots=True)
class Session:
    """One client. `key` is its public key, None on an open board."""

    name: str
    key: str | None
    lease: Lease
    expires_ns: int = 0
    connection: bytes | None = None
    """Routing id of the connection that brought the newest lease; None = it broke."""
    order: SendOrder = field(default_factory=SendOrder)
    in_order: InOrder | None = None
    """Position of a bounded run; None = the client has asked for none."""
    is_ended: bool = False
    """`end` is sent: the client is not served any more, unless it comes back over a new connection."""

    def renew(self, lease: Lease, connection: bytes, now_ns: int, frame_period_ns: int) -> None:
        """Take a newer lease, over a new connection perhaps."""
        is_first = connection != self.connection
        if is_first:
            self.connection = connection
            self.in_order, self.is_ended = None, False
        if lease.run is None:
            self.in_order = None
        elif self.in_order is None or self.in_order.asked.period_s != lease.run.period_s:
            self.in_order = InOrder(lease.run, frame_period_ns)
        self.lease = lease
        self.expires_ns = now_ns + LEASE_NS
        self.order.renew(lease, is_first=is_first)

    def broke(self) -> None:
        """The connection is gone; the client is expected back until its lease ends."""
        self.connection = None
        self.order.wanted.clear()
