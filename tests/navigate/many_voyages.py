"""Scenario 5.3 with many seeds at once: what is measured as arrays, and filters that carry all boats as one array.

The rates are those of the voyage (GPS 1 Hz, compass 10 Hz, IMU 20 Hz); facts and filters are the station's.
Frames, their delays and the timeline are left out: what they change of the headings is bounded in `test_voyages.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.simulation.measured import COUNTS_PER_DEG_S, COUNTS_PER_M_S2
from common.simulation.readings import FixReading, HeadingReading, ImuReading
from common.simulation.scenarios import scenario_voyage
from common.simulation.voyage import Voyage
from common.units import NS_PER_S
from shore.navigation.filter_registry import build_filter
from shore.navigation.filters import Filter
from shore.navigation.initial_state import first_state
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.motion_model import ImuInput
from shore.navigation.numbers import Array
from shore.navigation.sensor_facts import facts_of
from shore.navigation.state_space import HEADING
from tests.offline import believing

IMU_S = 0.05
"""Between two samples of the IMU; every second one has a heading, every twentieth a fix as well."""
COMPASS, GPS = 2, 20


@dataclass(frozen=True)
class Many:
    """Boats of one scenario; step 0 is the start."""

    voyage: Voyage
    """One of them: truth and facts are those of all."""
    imu: Array
    """(k, 3, boats), forward and starboard m/s^2, rad/s; sample k ends step k + 1."""
    fixes: Array
    """(k, 4, boats), east and north m, m/s."""
    headings: Array
    """(k, boats), rad within +-pi."""


def sail_many(seeds: Sequence[int]) -> Many:
    """Scenario 5.3 with these seeds."""
    columns = [_columns(scenario_voyage("5.3", seed=seed)) for seed in seeds]
    imu, fixes, headings = (np.stack(kind, axis=-1) for kind in zip(*columns, strict=True))
    return Many(scenario_voyage("5.3", seed=seeds[0]), imu, fixes, headings)


def _columns(voyage: Voyage) -> tuple[Array, Array, Array]:
    """IMU (k, 3), fixes (k, 4) and headings (k,) of one boat, checked to come when `Many` says.

    Headings and samples are rounded as the devices print them; a bench without that differs by up to a tenth.
    """
    imu, fixes, headings, times = [], [], [], ([], [], [])  # type: ignore[var-annotated]
    for item in voyage.readings:
        reading = item.reading
        if isinstance(reading, FixReading):
            place = voyage.plane.to_east_north_m(reading.lat_deg, reading.lon_deg)
            fixes.append((*place, reading.v_east_m_s, reading.v_north_m_s))
            times[0].append(item.t_s)
        elif isinstance(reading, HeadingReading):
            headings.append(reading.heading_true_deg)
            times[1].append(item.t_s)
        else:
            assert isinstance(reading, ImuReading)
            imu.append((reading.accel_fwd_m_s2, reading.accel_stb_m_s2, np.radians(reading.yaw_rate_deg_s)))
            times[2].append(item.t_s)
    for kind, (every, first) in zip(times, ((GPS, 0), (COMPASS, 0), (1, 1)), strict=True):
        assert np.allclose(kind, IMU_S * (first + every * np.arange(len(kind))), atol=1e-6)
    variation_deg = voyage.boat.variation_deg or 0.0
    shown_deg = np.round(np.array(headings) - variation_deg, 1) + variation_deg
    wrapped = np.radians(np.mod(shown_deg + 180.0, 360.0) - 180.0)
    counts = np.array([COUNTS_PER_M_S2, COUNTS_PER_M_S2, COUNTS_PER_DEG_S * 180.0 / np.pi])
    return np.round(np.array(imu) * counts) / counts, np.array(fixes, dtype=float), wrapped


def heading_squares(name: str, many: Many, from_share: float, **told: float) -> Array:
    """Mean squared heading error, deg^2, of each boat from that share of the voyage on; `told` replaces facts."""
    voyage = believing(many.voyage, **told)
    each = _begin(name, many, voyage)
    truth = voyage.truth
    steps = len(many.imu)
    true_rad = np.interp(IMU_S * np.arange(steps + 1), truth.t_s, truth.heading_rad)
    sums, count = np.zeros(many.imu.shape[-1]), 0
    for step in range(1, steps + 1):
        each.predict(IMU_S, ImuInput(*many.imu[step - 1]))
        t_ns = round(step * IMU_S * NS_PER_S)
        if step % GPS == 0:
            each.update(Position(t_ns, "gps1", *many.fixes[step // GPS, :2]))
        if step % COMPASS == 0:
            each.update(TrueHeading(t_ns, "compass1", many.headings[step // COMPASS]))
            if step >= from_share * steps:
                error = each.estimate.x[:, HEADING] - true_rad[step]
                sums += np.degrees(np.angle(np.exp(1j * error))) ** 2
                count += 1
    return sums / count


def _begin(name: str, many: Many, voyage: Voyage) -> Filter:
    """A filter of all boats, each begun from its own first fix and heading."""
    facts = facts_of(voyage.config).plain
    each = build_filter(name, facts)
    first = []
    for (east_m, north_m, *velocity), heading in zip(many.fixes[0].T.tolist(), many.headings[0].tolist(), strict=True):
        position = Position(0, "gps1", east_m, north_m, (velocity[0], velocity[1]))
        first.append(first_state(0, position, TrueHeading(0, "compass1", heading), facts))
    x, P, read_from = zip(*first, strict=True)
    each.start(np.array(x), np.array(P), read_from[0])
    return each
