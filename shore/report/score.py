"""RMS errors of a log against a reference track: position and heading of raw sensors and of every filter.

Position error is horizontal distance (m), heading error is wrapped (deg). Estimates are scored at their own boat time,
fixes and headings at theirs; the reference is interpolated, never extrapolated.
"""

from array import array
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.angles import difference_deg, heading_deg
from common.boat_config import BoatConfig
from common.errors import WayfixError
from common.messages import Frame
from shore.navigation.measurements import Reader, TrueHeading
from shore.report.reference import Reference, read_reference

Array = NDArray[np.float64]

LATE_SHARE: Final = 0.75
"""Share of the scored time after which the last quarter begins."""
POSITION_CHANNELS: Final = (".east", ".north")
FIGURES: Final = ("nis_position", "nis_heading", "sigma_m", "sigma_deg")
"""Names of the figures that `Consistency` gives for each filter."""


@dataclass(slots=True)
class Errors:
    """Times and errors of one source: 16 bytes a value."""

    t_ns: "array[int]" = field(default_factory=lambda: array("q"))
    error: "array[float]" = field(default_factory=lambda: array("d"))

    def add(self, t_ns: int, error: float) -> None:
        """One scored value."""
        self.t_ns.append(t_ns)
        self.error.append(error)

    def rms(self, from_ns: float = 0.0) -> float | None:
        """Root mean square from boat time `from_ns` on; None without values."""
        values = np.asarray(self.error)[np.asarray(self.t_ns) >= from_ns]
        return float(np.sqrt(np.mean(np.square(values)))) if len(values) else None


class Score:
    """Collects errors of `gps`, `compass` and each filter."""

    def __init__(self, reference: Reference, config: BoatConfig) -> None:
        self.reference = reference
        self.position: dict[str, Errors] = {"gps": Errors()}
        self.heading: dict[str, Errors] = {"compass": Errors()}
        self._reader = Reader(config, lambda _event: None)
        self._has_position = False

    def take_frame(self, frame: Frame) -> None:
        """Raw fixes and headings of one frame."""
        for fix in frame.fixes:
            if fix.usable and fix.lat_deg is not None and fix.lon_deg is not None:
                self._position("gps", fix.t_ns, fix.lat_deg, fix.lon_deg)
        for measured in self._reader.read(frame):
            if isinstance(measured, TrueHeading):
                self._heading("compass", measured.t_ns, heading_deg(float(measured.heading_rad)))

    def take_estimate(self, record: dict[str, Any]) -> None:
        """One logged estimate (see `Estimate.as_record`)."""
        self._position(record["filter"], record["t_ns"], record["lat_deg"], record["lon_deg"])
        if record["heading_true_deg"] is not None:
            self._heading(record["filter"], record["t_ns"], record["heading_true_deg"])

    def summary(self) -> dict[str, dict[str, float | None]]:
        """RMS tables: whole run and last quarter, rounded to 0.1 mm and 0.0001 deg."""
        spans = [(min(errors.t_ns), max(errors.t_ns)) for errors in self.position.values() if errors.t_ns]
        first_ns, last_ns = min((low for low, _ in spans), default=0), max((high for _, high in spans), default=0)
        late_ns = first_ns + LATE_SHARE * (last_ns - first_ns)
        return {
            "position_rms_m": _rounded(self.position, 0.0),
            "heading_rms_deg": _rounded(self.heading, 0.0),
            "position_rms_m_last_quarter": _rounded(self.position, late_ns),
            "heading_rms_deg_last_quarter": _rounded(self.heading, late_ns),
        }

    def _position(self, name: str, t_ns: int, lat_deg: float, lon_deg: float) -> None:
        self._has_position = True
        truth = self.reference.at(t_ns)
        if truth is not None:
            east_m, north_m = self.reference.plane.to_east_north_m(lat_deg, lon_deg)
            self.position.setdefault(name, Errors()).add(
                t_ns, float(np.hypot(east_m - truth.east_m, north_m - truth.north_m))
            )

    def _heading(self, name: str, t_ns: int, heading_true_deg: float) -> None:
        truth = self.reference.at(t_ns)
        if truth is not None and truth.heading_deg is not None:
            self.heading.setdefault(name, Errors()).add(t_ns, difference_deg(heading_true_deg, truth.heading_deg))

    def check(self, reference: Path) -> None:
        """After the last value: raises WayfixError when no position could be scored."""
        if not self._has_position:
            cure = "a boat without a receiver cannot be scored"
            raise WayfixError("the log has neither a fix nor an estimate to compare", str(reference), cure)
        if not any(errors.t_ns for errors in self.position.values()):
            cure = "give the track of the same trip, with UTC, t_s from its first frame, or t_ns on the boat clock"
            raise WayfixError("does not overlap with the log in time", str(reference), cure)


def _rounded(sources: dict[str, Errors], from_ns: float) -> dict[str, float | None]:
    values = {name: errors.rms(from_ns) for name, errors in sources.items()}
    return {name: None if value is None else round(value, 4) for name, value in values.items()}


def score_of(
    reference: Path, config: BoatConfig, frames: Iterable[Frame], estimates: Iterable[dict[str, Any]]
) -> Score:
    """Score frames and estimate records, each gone through once, against a reference file; raises WayfixError."""
    frames = iter(frames)
    first = next(frames)
    score = Score(read_reference(reference, first.t0_ns), config)
    for frame in chain((first,), frames):
        score.take_frame(frame)
    for record in estimates:
        score.take_estimate(record)
    score.check(reference)
    return score


def score_table(summary: dict[str, Any]) -> str:
    """The short table for a person."""
    columns = [summary[name + late] for name in ("position_rms_m", "heading_rms_deg") for late in ("", "_last_quarter")]
    lines = [
        f"{'':14}{'position RMS, m':>22}{'heading RMS, deg':>24}",
        f"{'':14}{'whole':>11}{'last 1/4':>11}{'whole':>13}{'last 1/4':>11}",
    ]
    names = dict.fromkeys(name for column in columns for name in column)
    is_filter = {name: name in columns[0] and name in columns[2] for name in names}
    for name in sorted(names, key=is_filter.__getitem__):  # the sensors first, then what is made of them
        cells = [column.get(name) for column in columns]
        texts = ["" if cell is None else f"{cell:.2f}" for cell in cells]
        lines.append(f"{name:14}{texts[0]:>11}{texts[1]:>11}{texts[2]:>13}{texts[3]:>11}")
    return "\n".join(lines)


class Consistency:
    """Filter consistency without a reference (NIS, sigma): how well each covariance fits the innovations."""

    def __init__(self) -> None:
        self._sums: dict[str, dict[str, tuple[float, int]]] = {}
        """Sum and count of each figure, by filter and figure."""
        self._last: dict[tuple[str, str], float] = {}
        """NIS of the newest update, by (filter, channel)."""

    def take(self, record: dict[str, Any]) -> None:
        """One estimate (`Estimate.as_record`); only its valid parts count."""
        if "position" not in record["aligned_parts"]:
            return
        name = record["filter"]
        self._add(name, "sigma_m", float(np.hypot(record["sigma_east_m"], record["sigma_north_m"])))
        if record["aligned"]:
            self._add(name, "sigma_deg", record["sigma_heading_deg"])
        for channel, report in record["channels"].items():
            nis = report["nis"]
            if nis is not None and self._last.get((name, channel)) != nis:
                self._last[name, channel] = nis
                self._add(name, "nis_position" if channel.endswith(POSITION_CHANNELS) else "nis_heading", nis)

    def summary(self) -> dict[str, dict[str, float | int | None]]:
        """Mean NIS per dimension (1 = its doubt fits), mean 1-sigma and count of aligned estimates, for each filter."""
        return {
            name: {
                **{figure: _mean(sums.get(figure)) for figure in FIGURES},
                "aligned": sums.get("sigma_deg", (0.0, 0))[1],
            }
            for name, sums in self._sums.items()
        }

    def _add(self, name: str, figure: str, value: float) -> None:
        sums = self._sums.setdefault(name, {})
        total, count = sums.get(figure, (0.0, 0))
        sums[figure] = total + value, count + 1


def _mean(summed: tuple[float, int] | None) -> float | None:
    return None if summed is None else round(summed[0] / summed[1], 4)


def consistency_table(summary: dict[str, dict[str, float | int | None]]) -> str:
    """The short table for a person."""
    lines = [
        f"{'':14}{'NIS per dimension':>22}{'mean 1-sigma':>24}",
        f"{'':14}{'position':>11}{'heading':>11}{'m':>13}{'deg':>11}{'aligned':>11}",
    ]
    for name, figures in summary.items():
        texts = ["" if (value := figures[figure]) is None else f"{value:.2f}" for figure in FIGURES]
        cells = f"{texts[0]:>11}{texts[1]:>11}{texts[2]:>13}{texts[3]:>11}"
        lines.append(f"{name:14}{cells}{figures['aligned']:>11}")
    return "\n".join(lines)
