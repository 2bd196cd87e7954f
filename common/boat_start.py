"""Which start of the board a frame belongs to, and whether that is an older or a newer one (boot ordering).

Boat times can be compared only within one `clock_id` (one boot of the board). `start_no` counts the starts of the
daemon and grows over boots, so it says which of two clocks is the newer one.
"""

from typing import NamedTuple, Self

from common.messages import Frame


class BoatStart(NamedTuple):
    """A start of the board's daemon."""

    clock_id: str
    start_no: int

    @classmethod
    def of(cls, frame: Frame) -> Self:
        """The start that made the frame."""
        return cls(frame.clock_id, frame.start_no)

    def is_before(self, other: "BoatStart") -> bool:
        """True for another clock that ended before the one of `other` began."""
        return self.clock_id != other.clock_id and self.start_no < other.start_no

    def followed_by(self, frame: Frame) -> "BoatStart":
        """The newest start once `frame`, which is not of an older clock, has come."""
        return BoatStart(frame.clock_id, max(self.start_no, frame.start_no))
