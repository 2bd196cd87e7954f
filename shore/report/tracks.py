"""The picture of a run: tracks, headings and position errors of raw sensors and filters against the truth."""

from pathlib import Path
from typing import Any, Final

import numpy as np

from common.messages import Frame
from common.units import NS_PER_S
from shore.score import Score

COLOURS: Final = {"kf": "#8c6bb1", "ukf": "#2a9d4a", "fuzzy-thesis": "#e08a1e", "fuzzy": "#d62839"}
RAW: Final = "#9db4c8"
TRUTH: Final = "#222222"
INSET_M: Final = 45.0


def draw(path: Path, score: Score, frames: list[Frame], estimates: list[dict[str, Any]], title: str) -> None:
    """Write a PNG; raises ImportError when matplotlib is missing."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    filters = list(dict.fromkeys(item["filter"] for item in estimates))
    tracks = {name: _track(score, [item for item in estimates if item["filter"] == name]) for name in filters}
    figure = plt.figure(figsize=(14, 8), dpi=110, layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1))
    figure.suptitle(title, fontsize=13)
    _draw_tracks(figure.add_subplot(grid[:, 0]), score, frames, tracks)
    _draw_errors(figure.add_subplot(grid[0, 1]), score, filters)
    _draw_heading_errors(figure.add_subplot(grid[1, 1]), score, filters)
    figure.savefig(path)
    plt.close(figure)


def _track(score: Score, estimates: list[dict[str, Any]]) -> np.ndarray[Any, Any]:
    """(m, 2) east/north metres about the reference's first point."""
    return np.array([score.reference.plane.to_east_north_m(item["lat_deg"], item["lon_deg"]) for item in estimates])


def _draw_tracks(axes: Any, score: Score, frames: list[Frame], tracks: dict[str, np.ndarray[Any, Any]]) -> None:
    plane = score.reference.plane
    fixes = [fix for frame in frames for fix in frame.fixes if fix.usable]
    points = np.array([plane.to_east_north_m(fix.lat_deg or 0.0, fix.lon_deg or 0.0) for fix in fixes])
    middle = len(score.reference.east_m) * 2 // 3
    centre = score.reference.east_m[middle], score.reference.north_m[middle]
    inset = axes.inset_axes((0.56, 0.03, 0.42, 0.36))
    for axis, width in ((axes, 1.4), (inset, 1.8)):
        if len(points):
            axis.plot(*points.T, ".", color=RAW, markersize=4, label="GPS fixes", zorder=1)
        axis.plot(score.reference.east_m, score.reference.north_m, color=TRUTH, linewidth=2.4, label="truth", zorder=2)
        for name, track in tracks.items():
            axis.plot(*track.T, color=COLOURS.get(name), linewidth=width, label=name, zorder=3)
        axis.set_aspect("equal")
    inset.set_xlim(centre[0] - INSET_M, centre[0] + INSET_M)
    inset.set_ylim(centre[1] - INSET_M, centre[1] + INSET_M)
    inset.set_xticks([])
    inset.set_yticks([])
    axes.indicate_inset_zoom(inset, edgecolor="#555555")
    axes.set(xlabel="east, m", ylabel="north, m", title="Tracks")
    axes.grid(alpha=0.25)
    axes.legend(loc="upper left")


def _draw_errors(axes: Any, score: Score, filters: list[str]) -> None:
    _running(axes, score, score.position, {"gps": RAW, **{name: COLOURS.get(name) for name in filters}})
    axes.set(ylabel="m", title="Position error, RMS over 20 s")


def _draw_heading_errors(axes: Any, score: Score, filters: list[str]) -> None:
    _running(axes, score, score.heading, {"compass": RAW, **{name: COLOURS.get(name) for name in filters}})
    axes.set(xlabel="time, s", ylabel="deg", title="Heading error, RMS over 20 s")


def _running(axes: Any, score: Score, sources: dict[str, Any], colours: dict[str, str | None]) -> None:
    """RMS in windows of 20 s, log scale: raw and filtered differ by a factor of ten and more."""
    for name, colour in colours.items():
        errors = sources[name]
        if not errors.t_ns:
            continue
        t_s = (np.array(errors.t_ns) - score.reference.start_ns) / NS_PER_S
        bins = np.floor(t_s / 20.0).astype(int)
        counts = np.bincount(bins)
        sums = np.bincount(bins, weights=np.square(errors.error))
        filled = counts > 0
        axes.plot(
            (np.arange(len(counts))[filled] + 0.5) * 20.0,
            np.sqrt(sums[filled] / counts[filled]),
            color=colour,
            linewidth=1.8,
            label=name,
        )
    axes.set_yscale("log")
    axes.grid(alpha=0.25, which="both")
    axes.legend(loc="upper left", ncols=2, fontsize=9)
