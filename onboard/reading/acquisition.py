"""Acquisition pipeline, from bytes to frames: the daemon feeds it from ports, `convert` from files. Pure.

port chunk -> lines -> devices -> framer --tick--> frame
                          |
                          `-> health (counts, silence)
"""

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from common.boat_config import BoatConfig
from common.events import event
from common.framer import Framer, Identity, Measurement
from common.messages import ClockPair, Event, Frame
from common.settings import as_dict
from onboard.config import byte_budget
from onboard.devices.gps.dates import Dates
from onboard.reading.byte_budget import ByteBudget
from onboard.reading.line_quality import Wire
from onboard.reading.port_chain import PortChain
from onboard.reading.sensor_health import SensorMonitor
from onboard.reading.utc_clock import ClockMap


@cache
def versions() -> dict[str, str]:
    """Versions of what decides the result; goes into `connected` and the log. They lie in files, and are read once."""
    found = {}
    for name in ("wayfix", "pyserial", "pynmea2", "pyzmq", "msgpack"):
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


class Acquisition:
    """All ports of one boat on their way into frames. Reads no clock: every call brings its time."""

    def __init__(
        self,
        config: BoatConfig,
        identity: Identity,
        t0_ns: int,
        now_ns: int,
        tell: Callable[[Event], None],
        *,
        is_archive: bool = False,
    ) -> None:
        """t0_ns: start of the first frame; tell: takes every event, beside the frame.

        is_archive: the lines are of a recording, whose dates may be of past years.
        """
        self.config = config
        self.identity = identity
        self.framer = Framer(identity, [sensor.id for sensor in config.with_role("imu")], t0_ns)
        wires = {table.name: Wire() for table in config.port}
        self.monitors = {sensor.id: SensorMonitor(sensor, now_ns, wires[sensor.port]) for sensor in config.sensor}
        self.clock_map = ClockMap(self.happened)
        rolled_over = [sensor.id for sensor in config.sensor if sensor.week_rollover]
        self.dates = Dates(self.happened, rolled_over, is_archive=is_archive)
        self.chains = [
            PortChain(
                table,
                ByteBudget(byte_budget(table, config)),
                [monitor for monitor in self.monitors.values() if monitor.table.port == table.name],
                wires[table.name],
                self,
            )
            for table in config.port
        ]
        self._tell = tell
        self._config_fields = as_dict(config)

    def take(self, measurement: Measurement, now_ns: int) -> None:
        """A measurement of any driver goes into the frame; clock pairs whose date can be also move the UTC mapping."""
        if isinstance(measurement, ClockPair):
            pair = self.dates.judge(measurement, self.clock_map.at(measurement.t_ns))
            if pair is None:
                return
            if (step_s := self.clock_map.add(pair)) is not None:
                self.happened(event("clock-stepped", now_ns, pair.sensor, sensor=pair.sensor, step_s=step_s))
            measurement = pair
        self.framer.add(measurement)

    def happened(self, happening: Event) -> None:
        """Put the event into the frame as a record, and report it."""
        self._tell(happening)
        self.framer.add(happening)

    def frame(self, t1_ns: int) -> Frame:
        """The frame that ends at t1, with the health that is due."""
        health = []
        for monitor in self.monitors.values():
            report, happening = monitor.report(t1_ns)
            if happening is not None:
                self.happened(happening)
            if report is not None:
                health.append(report)
        utc = self.clock_map.at(self.framer.t0_ns)
        return self.framer.tick(t1_ns, utc, self.clock_map.epoch, health)

    def greeting(self, now_ns: int, clock_rate: float) -> dict[str, Any]:
        """The fields of `connected` (docs/protocol.md): who sends, how it is made, how its sensors are."""
        identity = self.identity
        states = ((monitor.table.id, *monitor.state(now_ns)) for monitor in self.monitors.values())
        return {
            "boat_id": identity.boat_id,
            "boot_id": identity.boot_id,
            "clock_id": identity.clock_id,
            "start_no": identity.start_no,
            "next_seq": self.framer.next_seq,
            "clock_rate": clock_rate,
            "config": self._config_fields,
            "versions": versions(),
            "sensors": [{"id": sensor, "state": state, "reason": reason} for sensor, state, reason in states],
        }
