"""A voyage through framer and pipeline in this process: no ports, no sockets, no waiting."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from common.angles import difference_deg
from common.codec import decode_frame, encode_frame
from common.messages import Frame
from common.simulation import without_ports
from common.simulation.voyage import Voyage
from common.simulation.without_ports import START_NS
from common.units import NS_PER_S
from shore.navigation.estimate import Estimate
from shore.navigation.state_space import HEADING
from shore.pipeline import Output, Pipeline


def frames_of(voyage: Voyage) -> list[Frame]:
    """All frames of a voyage."""
    return list(without_ports.frames_of(voyage))


def believing(voyage: Voyage, **facts: object) -> Voyage:
    """The voyage of a boat whose file says so of its sensors."""
    sensors = tuple(replace(sensor, **facts) for sensor in voyage.config.sensor)  # type: ignore[arg-type]
    return replace(voyage, config=replace(voyage.config, sensor=sensors))


def without_latency(voyage: Voyage) -> Voyage:
    """The voyage of a recording whose fixes already stand at the time at which the boat knew them."""
    return believing(voyage, latency_ms=0.0)


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


def compensated(voyage: Voyage) -> Voyage:
    """Its boat's file says that the compasses have no lasting errors, and the water no current: then noise is left."""
    sensors = (
        replace(item, compass_bias_sigma_deg=0.0, compass_deviation_sigma_deg=0.0) for item in voyage.config.sensor
    )
    boat = replace(voyage.config.boat, current_sigma_m_s=0.0, leeway_m_s=0.0)
    return replace(voyage, config=replace(voyage.config, boat=boat, sensor=tuple(sensors)))


def errors_of(voyage: Voyage, filters: Sequence[str], **imu: object) -> dict[str, Errors]:
    """Run the filters over a voyage; `imu` replaces facts of the IMU (`use=()` = the filters go without it)."""
    config = voyage.config
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
        difference_deg(float(np.degrees(item.state[HEADING])), float(np.degrees(true)))
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
