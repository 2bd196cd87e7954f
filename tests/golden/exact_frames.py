"""Frames of the golden cases: readings of the three-port boat as they are, without a device's digits and without UTC.

The cases were recorded like this; `common/simulation/without_ports.py` rounds as devices print.
"""

from collections.abc import Iterator
from heapq import merge

import numpy as np

from common.framer import Framer, Identity, ImuSample, Utc
from common.messages import Fix, Frame, Heading
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Timed
from common.simulation.voyage import Voyage
from common.simulation.without_ports import START_NS
from common.units import M_S_PER_KN, NS_PER_S

FRAME_NS = NS_PER_S // 10
FIX_DELAY_S = 0.75
"""Receiver latency, three sentences at 4800 baud and the end of the epoch."""


def exact_frames(voyage: Voyage) -> Iterator[Frame]:
    framer = Framer(Identity("offline", "0" * 16, "clock", 1), ["imu1"], START_NS)
    variation_deg = voyage.boat.variation_deg or 0.0
    fixes = ((item.t_s + FIX_DELAY_S, item) for item in voyage.readings if isinstance(item.reading, FixReading))
    others = ((item.t_s, item) for item in voyage.readings if not isinstance(item.reading, FixReading))
    t1_ns = START_NS + FRAME_NS
    for arrival_s, item in merge(fixes, others, key=lambda pair: pair[0]):
        while START_NS + arrival_s * NS_PER_S >= t1_ns:
            yield framer.tick(t1_ns, Utc(None, None, "none"), 0, ())
            t1_ns += FRAME_NS
        framer.add(_measurement(item, variation_deg))
    yield framer.tick(t1_ns, Utc(None, None, "none"), 0, ())


def _measurement(item: Timed, variation_deg: float) -> Fix | Heading | ImuSample:
    t_ns = START_NS + round(item.t_s * 1e6) * 1000
    match item.reading:
        case FixReading(lat_deg, lon_deg, float(v_east), float(v_north)):
            return Fix(
                sensor=item.sensor,
                t_ns=t_ns,
                lat_deg=lat_deg,
                lon_deg=lon_deg,
                fix_quality=1,
                sog_kn=float(np.hypot(v_east, v_north)) / M_S_PER_KN,
                cog_true_deg=float(np.degrees(np.arctan2(v_east, v_north)) % 360.0),
            )
        case HeadingReading(heading_deg):
            return Heading(sensor=item.sensor, t_ns=t_ns, heading_mag_deg=(heading_deg - variation_deg) % 360.0)
        case ImuReading(fwd, stb, yaw_rate):
            return ImuSample(item.sensor, t_ns, fwd, stb, yaw_rate)
    raise TypeError(f"the three-port boat has no {item.reading}")
