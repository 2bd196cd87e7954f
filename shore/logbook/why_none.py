"""Diagnosis of a run without estimates (initial alignment): what its frames lack, in a sentence."""

from collections.abc import Iterable, Mapping

from common.messages import Frame, SensorHealth
from common.words import counted


class WhyNone:
    """Feed it the frames of a run in any order."""

    def __init__(self) -> None:
        self._frames = self._fixes = self._usable = 0
        self._has_heading = False
        self._health: dict[str, SensorHealth] = {}
        """The newest health report of each sensor."""

    def frame(self, frame: Frame) -> None:
        """Take a frame; one that was read in part (`light_frame`) will do."""
        self._frames += 1
        self._fixes += len(frame.fixes)
        self._usable += sum(fix.usable for fix in frame.fixes)
        self._has_heading = self._has_heading or bool(frame.headings)
        for report in frame.health:
            known = self._health.get(report.sensor)
            if known is None or known.t_ns <= report.t_ns:
                self._health[report.sensor] = report

    def text(self, roles: Mapping[str, str]) -> str:
        """Why no filter could start. roles: role of each sensor of the boat, by its id."""
        receivers, compasses = ([name for name, role in roles.items() if role == each] for each in ("gps", "compass"))
        if not self._frames:
            return "no frame came"
        if not receivers:
            return "the boat's file names no gps"
        if not self._fixes:
            return f"no fix came{self._states(receivers)}"
        if not self._usable:
            return f"none of {counted(self._fixes, 'fix', 'fixes')} is usable (void, repeated or estimated)"
        if not compasses:
            return "no compass is named, and a course is taken as heading only at 2 kn or more"
        if not self._has_heading and not any(self._accepted(name) for name in compasses):
            return f"no heading came{self._states(compasses)}"
        return "position and heading did not come together for long enough"

    def _accepted(self, sensor: str) -> int:
        return self._health[sensor].accepted if sensor in self._health else 0

    def _states(self, sensors: Iterable[str]) -> str:
        """How the sensors were at the end: ` (gps1 missing: no such file)`."""
        found = [self._health[name] for name in sensors if name in self._health]
        told = [f"{each.sensor} {each.state}{f': {each.reason}' if each.reason else ''}" for each in found]
        return f" ({'; '.join(told)})" if told else ""
