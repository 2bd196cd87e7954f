"""A voyage through framer and pipeline in this process: no ports, no sockets, no waiting."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from heapq import merge as in_order

import numpy as np

from common.angles import difference_deg
from common.boat_config import BoatConfig
from common.codec import decode_frame, encode_frame
from common.framer import Framer, Identity, ImuSample, Utc
from common.messages import Fix, Frame, Heading
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Timed
from common.simulation.voyage import Voyage
from common.units import M_S_PER_KN, NS_PER_S
from onboard.virtual.voyage_files import boat_config
from shore.navigation.estimate import Estimate
from shore.pipeline import Output, Pipeline

FRAME_NS = NS_PER_S // 10
START_NS = 1000 * NS_PER_S
FIX_DELAY_S = 0.75
"""Receiver latency, three sentences at 4800 baud and the end of the epoch: what the real path shows."""


def config_of(voyage: Voyage) -> BoatConfig:
    return boat_config(voyage, dict.fromkeys(("gps", "compass", "imu"), "unused"), "unused")


def frames_of(voyage: Voyage) -> list[Frame]:
    """The frames the board would send: each measurement in the frame in which it arrives."""
    framer = Framer(Identity("offline", "0" * 16, "clock", 1), ["imu1"], START_NS)
    variation_deg = voyage.boat.variation_deg or 0.0
    fixes = ((item.t_s + FIX_DELAY_S, item) for item in voyage.readings if isinstance(item.reading, FixReading))
    others = ((item.t_s, item) for item in voyage.readings if not isinstance(item.reading, FixReading))
    frames = []
    t1_ns = START_NS + FRAME_NS
    for arrival_s, item in in_order(fixes, others, key=lambda pair: pair[0]):
        while START_NS + arrival_s * NS_PER_S >= t1_ns:
            frames.append(framer.tick(t1_ns, Utc(None, None, "none"), 0, ()))
            t1_ns += FRAME_NS
        framer.add(_measurement(item, variation_deg))
    frames.append(framer.tick(t1_ns, Utc(None, None, "none"), 0, ()))
    return frames


def _measurement(item: Timed, variation_deg: float) -> Fix | Heading | ImuSample:
    t_ns = START_NS + round(item.t_s * 1e6) * 1000
    reading = item.reading
    if isinstance(reading, FixReading):
        speed = course = None
        if reading.v_east_m_s is not None and reading.v_north_m_s is not None:
            speed = float(np.hypot(reading.v_east_m_s, reading.v_north_m_s)) / M_S_PER_KN
            course = float(np.degrees(np.arctan2(reading.v_east_m_s, reading.v_north_m_s)) % 360.0)
        return Fix(
            sensor=item.sensor, t_ns=t_ns, lat_deg=reading.lat_deg, lon_deg=reading.lon_deg,
            fix_quality=1, sog_kn=speed, cog_true_deg=course,
        )  # fmt: skip
    if isinstance(reading, HeadingReading):
        return Heading(
            sensor=item.sensor, t_ns=t_ns, heading_mag_deg=(reading.heading_true_deg - variation_deg) % 360.0
        )
    assert isinstance(reading, ImuReading)
    return ImuSample(item.sensor, t_ns, reading.accel_fwd_m_s2, reading.accel_stb_m_s2, reading.yaw_rate_deg_s)


@dataclass(frozen=True)
class Errors:
    """Errors of one filter at each published estimate."""

    t_s: np.ndarray
    position_m: np.ndarray
    heading_deg: np.ndarray

    def rms_m(self, from_share: float = 0.0) -> float:
        return float(np.sqrt(np.mean(self.position_m[self._late(from_share)] ** 2)))

    def rms_deg(self, from_share: float = 0.0) -> float:
        return float(np.sqrt(np.mean(self.heading_deg[self._late(from_share)] ** 2)))

    def _late(self, share: float) -> np.ndarray:
        return np.asarray(self.t_s >= self.t_s[0] + share * (self.t_s[-1] - self.t_s[0]))


def errors_of(voyage: Voyage, filters: Sequence[str], **imu: object) -> dict[str, Errors]:
    """Run the filters over a voyage; `imu` replaces facts of the IMU (`use=()` = the filters go without it)."""
    config = config_of(voyage)
    sensors = tuple(replace(item, **imu) if item.role == "imu" else item for item in config.sensor)  # type: ignore[arg-type]
    pipeline = Pipeline(replace(config, sensor=sensors), filters)
    estimates = [estimate for frame in frames_of(voyage) for estimate in pipeline.push(frame).estimates]
    return {name: _errors(voyage, [item for item in estimates if item.filter == name]) for name in filters}


def _errors(voyage: Voyage, estimates: list[Estimate]) -> Errors:
    truth = voyage.truth
    times = np.array([(item.t_ns - START_NS) / NS_PER_S for item in estimates])
    inside = (times >= truth.t_s[0]) & (times <= truth.t_s[-1])
    places = np.array([voyage.plane.to_east_north_m(item.lat_deg, item.lon_deg) for item in estimates])
    east, north, heading = (
        np.interp(times, truth.t_s, column) for column in (truth.east_m, truth.north_m, truth.heading_rad)
    )
    wrong_deg = [
        difference_deg(item.heading_true_deg, float(np.degrees(true)))
        for item, true in zip(estimates, heading, strict=True)
    ]
    distance = np.hypot(places[:, 0] - east, places[:, 1] - north)
    return Errors(times[inside], distance[inside], np.array(wrong_deg)[inside])


def pushed(pipeline: Pipeline, frames: Iterable[Frame]) -> Iterator[tuple[bytes, Frame, Output]]:
    """Each frame as it travels, as it arrives, and what it led to."""
    for sent in frames:
        data = encode_frame(sent)
        frame = decode_frame(data)
        yield data, frame, pipeline.push(frame)
