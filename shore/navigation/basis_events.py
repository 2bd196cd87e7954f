"""Loss of position as events: what the estimates rest on has changed (fix lost and regained, its quality, the heading).

fix-lost, fix-regained   no usable fix for so long that positions are dead reckoning; and the first one after that
fix-quality-changed      fixes of a receiver are of another quality (GGA)
heading-unknown, heading-from-course, heading-from-compass

Each is said for the newest frames of the first filter, once a change, and not for a hole that the link made: the frames
in between bring their fixes later.
"""

from collections.abc import Mapping
from typing import Final

from common.messages import Frame
from common.units import NS_PER_S
from shore.navigation.basis import COASTING, COMPASS, COURSE, FIX
from shore.navigation.estimate import Estimate
from shore.navigation.filter_bank import Moment
from shore.navigation.notices import Notices
from shore.navigation.trust.receiver import Receiver

HOLE_NS: Final = NS_PER_S
"""Frames that are further apart than this have others between them, which are missing."""
SETTLED_NS: Final = 5 * NS_PER_S
"""Another source of the heading is said when it has lasted for this time."""
UNKNOWN: Final = "unknown"
HEADINGS: Final = {UNKNOWN: "heading-unknown", COURSE: "heading-from-course", COMPASS: "heading-from-compass"}
QUALITIES: Final = {
    1: "single",
    2: "differential",
    3: "PPS",
    4: "RTK fixed",
    5: "RTK float",
}
"""Words for the quality of GGA."""


class BasisEvents:
    """Says what has changed to the notices of a run."""

    def __init__(self, notices: Notices, lost_after_ns: int) -> None:
        self._notices = notices
        self._lost_after_ns = lost_after_ns
        self._newest_ns: int | None = None
        self._unbroken_ns = 0
        """Boat time from which on no frame is missing."""
        self._lost_since_ns: int | None = None
        """Boat time of the last fix when a loss was said; `None` = there are fixes."""
        self._receivers: Mapping[str, Receiver] = {}
        """What the filter remembers of them, as it was looked at last."""
        self._quality: dict[str, int | None] = {}
        self._heading = self._said_heading = COMPASS
        self._heading_ns = 0
        """Boat time since which the heading rests on that."""

    def take(self, frame: Frame, moment: Moment, estimate: Estimate | None) -> None:
        """Say what differs from the frame before. estimate: of the first filter, `None` = it has not started."""
        if self._newest_ns is None or frame.t0_ns - self._newest_ns > HOLE_NS:
            self._unbroken_ns = self._heading_ns = frame.t0_ns
        self._newest_ns = frame.t1_ns
        self._take_quality(moment)
        if estimate is not None:
            self._take_fix(estimate)
            self._take_heading(estimate)

    def _take_fix(self, estimate: Estimate) -> None:
        since_ns, lost_ns = estimate.position_since_ns, self._lost_since_ns
        if estimate.position_from == FIX:
            if lost_ns is not None:
                self._lost_since_ns = None
                # late fixes may have filled the hole: then the row is as old as it was before
                again_ns = since_ns if since_ns > lost_ns else estimate.t_ns
                self._notices.say("fix-regained", estimate.t_ns, seconds=_seconds(again_ns - lost_ns))
        elif lost_ns is None and estimate.t_ns - max(since_ns, self._unbroken_ns) > self._lost_after_ns:
            self._lost_since_ns = since_ns
            self._notices.say("fix-lost", estimate.t_ns, seconds=_seconds(estimate.t_ns - since_ns))

    def _take_quality(self, moment: Moment) -> None:
        trust = next((state.trust for state in moment.states if state is not None), None)
        if trust is None or trust.receivers is self._receivers:
            return
        self._receivers = trust.receivers
        for sensor, receiver in trust.receivers.items():
            before, quality = self._quality.get(sensor), receiver.quality
            if before is not None and quality is not None and quality != before:
                words = (QUALITIES.get(each, f"of quality {each}") for each in (before, quality))
                evidence = {"sensor": sensor, "before": next(words), "now": next(words)}
                self._notices.say("fix-quality-changed", moment.t_ns, **evidence)
            self._quality[sensor] = quality

    def _take_heading(self, estimate: Estimate) -> None:
        heading = estimate.heading_from or UNKNOWN
        if heading == COASTING or not estimate.aligned_parts:
            return
        if heading != self._heading:
            self._heading, self._heading_ns = heading, estimate.t_ns
        if heading != self._said_heading and estimate.t_ns - self._heading_ns >= SETTLED_NS:
            self._said_heading = heading
            self._notices.say(HEADINGS[heading], estimate.t_ns, sigma_deg=round(estimate.sigma_heading_deg))


def _seconds(time_ns: int) -> float:
    return round(time_ns / NS_PER_S, 1)
