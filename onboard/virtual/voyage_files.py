"""Output files of a voyage: the daemon's configuration and the ground truth, beside the ports."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from common.angles import wrap_deg
from common.boat_config import BoatConfig
from common.simulation.motion import Array, grid
from common.simulation.voyage import Voyage

TRUTH_HEADER = "t_s,lat_deg,lon_deg,heading_true_deg,t_ns,east_m,north_m,v_east_m_s,v_north_m_s"
TRUTH_RATE_HZ = 10.0
LONGEST_GAP_S = 1.0
"""Longest hole of a recording's reference over which the truth is interpolated, s."""


def placed(config: BoatConfig, ports: Mapping[str, str], bind: str) -> BoatConfig:
    """The boat's file with its ports (name -> path) and the daemon's address where they really are."""
    tables = tuple(replace(table, path=ports[table.name]) for table in config.port)
    return replace(config, link=replace(config.link, bind=bind), port=tables)


class TruthFile:
    """Truth at 10 Hz. All but the boat time is worked out beforehand: writing must not delay the first byte."""

    def __init__(self, voyage: Voyage) -> None:
        truth = voyage.truth.at(_covered(voyage.truth.t_s))
        columns = (truth.t_s, truth.east_m, truth.north_m, np.degrees(truth.heading_rad))
        velocity = (truth.v_east_m_s, truth.v_north_m_s)
        self._rows: list[tuple[float, str, str]] = []
        for t_s, east, north, heading, v_east, v_north in np.stack((*columns, *velocity), axis=1).tolist():
            lat, lon = voyage.plane.to_lat_lon_deg(east, north)
            before = f"{t_s:.3f},{lat:.9f},{lon:.9f},{wrap_deg(heading):.4f}"
            self._rows.append((t_s, before, f"{east:.4f},{north:.4f},{v_east:.5f},{v_north:.5f}"))

    def write(self, path: Path, start_ns: int) -> None:
        """Write it; t = 0 is boat time `start_ns`."""
        rows = (f"{before},{start_ns + round(t_s * 1e9)},{after}\n" for t_s, before, after in self._rows)
        path.write_text(f"{TRUTH_HEADER}\n{''.join(rows)}", encoding="ascii")


def _covered(t_s: Array) -> Array:
    """The times of the truth file that lie on the truth's own or between two that are close."""
    times = grid(float(t_s[-1]), TRUTH_RATE_HZ)
    times = times[times >= t_s[0]]
    after = np.searchsorted(t_s, times)
    before = np.searchsorted(t_s, times, side="right") - 1
    covered: Array = times[t_s[after] - t_s[before] <= LONGEST_GAP_S]
    return covered
