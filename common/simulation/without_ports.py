"""A voyage as the frames that the board would send, made in this process: no ports, no sockets, no waiting.

For benches: readings become measurements (`measured.py`), `common.framer` cuts frames, as on board.
"""

from collections.abc import Iterator
from heapq import merge
from typing import Final

from common.framer import Framer, Identity, Utc
from common.messages import Frame
from common.simulation.measured import Measured
from common.simulation.readings import Timed
from common.simulation.voyage import Voyage
from common.units import NS_PER_MS, NS_PER_S, NS_PER_US

START_NS: Final = 1000 * NS_PER_S
"""Boat time at the start of a voyage, ns."""
UTC_START_NS: Final = 1_420_027_200_000_000_000
"""Universal time at the start of a voyage: noon of the last day of 2014, the year of the thesis' trials."""
EPOCH_S: Final = 0.45
"""Time from the first byte of a receiver's epoch until its fix is known, s: three sentences at 4800 baud."""
_IDENTITY: Final = Identity("virtual", "0" * 16, "clock", 1)


def frames_of(voyage: Voyage) -> Iterator[Frame]:
    """The frames of a voyage: each measurement is in the frame in which it arrives, latency and epoch included."""
    config = voyage.config
    period_ns = round(NS_PER_S / config.frames.rate_hz)
    framer = Framer(_IDENTITY, [sensor.id for sensor in config.with_role("imu")], START_NS)
    t1_ns = START_NS + period_ns
    variation_deg = config.boat.variation_deg or 0.0
    each = {sensor.id: Measured(sensor, variation_deg, UTC_START_NS) for sensor in config.sensor}
    for arrival_s, timed in _arrivals(voyage):
        while START_NS + arrival_s * NS_PER_S >= t1_ns:
            yield framer.tick(t1_ns, _utc(t1_ns), 0, ())
            t1_ns += period_ns
        t_ns = START_NS + round(timed.t_s * 1e6) * NS_PER_US
        for measurement in each[timed.sensor].measurements(timed.t_s, t_ns, timed.reading):
            framer.add(measurement)
    yield framer.tick(t1_ns, _utc(t1_ns), 0, ())


def _arrivals(voyage: Voyage) -> Iterator[tuple[float, Timed]]:
    """When each reading is known on board, s, and the reading; in order of that time."""
    delays = {
        sensor.id: sensor.latency_ms / 1000.0 + (EPOCH_S if sensor.role == "gps" else 0.0)
        for sensor in voyage.config.sensor
    }

    def late(delay_s: float) -> Iterator[tuple[float, Timed]]:
        return ((timed.t_s + delay_s, timed) for timed in voyage.readings if delays[timed.sensor] == delay_s)

    return merge(*map(late, sorted(set(delays.values()), reverse=True)), key=lambda pair: pair[0])


def _utc(t_ns: int) -> Utc:
    return Utc(UTC_START_NS + t_ns - START_NS, NS_PER_MS, "gnss")
