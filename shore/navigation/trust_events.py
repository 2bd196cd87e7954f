"""Fault annunciation: what a filter sets aside and takes back becomes events, each change once.

It is read off the memory of the first filter at the end of each frame, never while it judges: a rewind may take a
verdict back.
"""

from typing import Final

from shore.navigation.filter_bank import Moment
from shore.navigation.imu_track import ImuTrack
from shore.navigation.notices import Notices

BACK: Final = {
    "velocity-set-aside": "velocity-taken-back",
    "compass-set-aside": "compass-taken-back",
    "gyro-set-aside": "gyro-taken-back",
}


class TrustEvents:
    """Says what has changed to the notices of a run."""

    def __init__(self, notices: Notices, imu: ImuTrack | None, driver: str) -> None:
        """driver: id of the IMU or gyro that the filters use."""
        self._notices = notices
        self._imu = imu
        self._driver = driver
        self._aside: dict[tuple[str, str], int] = {}
        """What is set aside as it was said, and since when."""
        self._repeats = False

    def take(self, moment: Moment) -> None:
        """Say what differs from the last frame's end."""
        trust = next((state.trust for state in moment.states if state is not None), None)
        self._take_repeats(moment.t_ns)
        if trust is None:
            return
        now = {(code, sensor or self._driver): since for code, sensor, since in trust.verdicts}
        for (code, sensor), since in now.items():
            if (code, sensor) not in self._aside:
                self._notices.say(code, since, sensor=sensor)
        for code, sensor in self._aside:
            if (code, sensor) not in now:
                self._notices.say(BACK[code], moment.t_ns, sensor=sensor)
        self._aside = now

    def _take_repeats(self, t_ns: int) -> None:
        if self._imu is None or self._imu.repeats == self._repeats:
            return
        self._repeats = self._imu.repeats
        self._notices.say("imu-repeats" if self._repeats else "imu-alive", t_ns, sensor=self._driver)
