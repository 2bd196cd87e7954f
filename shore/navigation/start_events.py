"""The stages of a start as events: filter-waiting, filter-started, filter-aligned (initial alignment), each once.

filter-waiting   for 5 s no filter could start; says what they wait for
filter-started   the first estimate, and where
filter-aligned   the first filter lacks nothing any more, so its estimates are valid (`initial_alignment.py`)
"""

from collections.abc import Sequence
from typing import Final

from common.units import NS_PER_S
from shore.navigation.estimate import Estimate
from shore.navigation.filter_bank import Moment
from shore.navigation.initial_alignment import Waiting, before_start
from shore.navigation.notices import Notices

WAITING_AFTER_NS: Final = 5 * NS_PER_S
"""With healthy sensors a start takes one to three seconds; only a longer one is worth a word."""


class StartEvents:
    """Says the stages of one run to its notices."""

    def __init__(self, notices: Notices, *, has_compass: bool) -> None:
        self._notices = notices
        self._has_compass = has_compass

    def take(
        self,
        moments: Sequence[Moment],
        estimates: Sequence[Estimate],
        waiting: Waiting | None,
        *,
        first_ns: int,
        newest_ns: int,
    ) -> None:
        """Say what a frame has reached.

        moments, estimates: what the frame led to. waiting: what the first filter lacks, `None` = not the newest frame.
        first_ns, newest_ns: when the run began and its newest frame ended, boat time.
        """
        notices = self._notices
        if estimates and notices.once("filter-started"):
            lat_deg, lon_deg = round(estimates[0].lat_deg, 6), round(estimates[0].lon_deg, 6)
            notices.say("filter-started", estimates[0].t_ns, lat_deg=lat_deg, lon_deg=lon_deg)
            notices.once("filter-waiting")  # a filter that runs waits for nothing any more
        late = next((moment for moment in moments if moment.t_ns - first_ns >= WAITING_AFTER_NS), None)
        if late is not None and notices.once("filter-waiting"):
            missing = before_start(late.position, late.heading, self._has_compass)
            notices.say("filter-waiting", late.t_ns, missing=", ".join(missing))
        if waiting == () and notices.once("filter-aligned"):
            notices.say("filter-aligned", newest_ns)
