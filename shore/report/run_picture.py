"""Error plots of a run: tracks, headings and position errors of raw sensors and filters against the truth."""

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from common.messages import Frame
from common.units import NS_PER_S
from shore.report.score import Errors, Score

Points = NDArray[np.float64]

WINDOW_S: Final = 20.0
STYLES: Final[dict[str, dict[str, Any]]] = {
    "gps": {"color": "#9db4c8", "linewidth": 1.6},
    "compass": {"color": "#9db4c8", "linewidth": 1.6},
    "truth": {"color": "#222222", "linewidth": 2.4},
    # KF and UKF lie on top of each other on slow boats: one wide, one dashed, so that both are seen.
    "kf": {"color": "#b9a3d6", "linewidth": 3.2},
    "ukf": {"color": "#1b7f4b", "linewidth": 1.5, "linestyle": (0, (5, 3))},
    "fuzzy-thesis": {"color": "#e9a23b", "linewidth": 3.2},
    "fuzzy": {"color": "#d62839", "linewidth": 1.5},
}
DRAWN_FIRST: Final = ("kf", "fuzzy-thesis", "ukf", "fuzzy")
INSET_M: Final = 45.0
"""Half width of the enlarged piece of track, m."""
LEAST_TRACK_M = 4.0 * INSET_M
"""A track that spans less is large enough as it is."""
CORNERS: Final = ((0, 1), (1, 1), (0, 0), (1, 0))


def draw(path: Path, score: Score, frames: list[Frame], estimates: list[dict[str, Any]], title: str) -> None:
    """Write a PNG; raises ImportError when matplotlib is missing."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    present = dict.fromkeys(item["filter"] for item in estimates)
    filters = sorted(present, key=lambda name: DRAWN_FIRST.index(name) if name in DRAWN_FIRST else 0)
    tracks = {name: _track(score, [item for item in estimates if item["filter"] == name]) for name in filters}
    figure = plt.figure(figsize=(14, 8), dpi=110, layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1))
    figure.suptitle(title, fontsize=13)
    _draw_tracks(figure.add_subplot(grid[:, 0]), score, frames, tracks)
    upper = figure.add_subplot(grid[0, 1])
    _draw_errors(upper, score, score.position, ["gps", *filters])
    upper.set(ylabel="m", title="Position error, RMS over 20 s")
    lower = figure.add_subplot(grid[1, 1], sharex=upper)
    _draw_errors(lower, score, score.heading, ["compass", *filters])
    lower.set(xlabel="time, s", ylabel="deg", title="Heading error, RMS over 20 s")
    figure.savefig(path)
    plt.close(figure)


def _track(score: Score, estimates: list[dict[str, Any]]) -> Points:
    """Track (m, 2), east/north metres about the reference's first point."""
    return np.array([score.reference.plane.to_east_north_m(item["lat_deg"], item["lon_deg"]) for item in estimates])


def _draw_tracks(axes: Any, score: Score, frames: list[Frame], tracks: dict[str, Points]) -> None:
    plane = score.reference.plane
    fixes = [fix for frame in frames for fix in frame.fixes if fix.usable]
    points = np.array([plane.to_east_north_m(fix.lat_deg or 0.0, fix.lon_deg or 0.0) for fix in fixes]).reshape(-1, 2)
    truth = np.column_stack((score.reference.east_m, score.reference.north_m))
    inset = None
    if max(np.ptp(truth, axis=0)) > LEAST_TRACK_M:
        x, y = _emptiest_corner(np.vstack((points, truth)))
        inset = axes.inset_axes((0.02 + x * 0.54, 0.02 + y * 0.56, 0.42, 0.40))
    for axis in (axes,) if inset is None else (axes, inset):
        axis.plot(*points.T, ".", color=STYLES["gps"]["color"], markersize=4, label="GPS fixes")
        axis.plot(*truth.T, label="truth", **STYLES["truth"])
        for name, track in tracks.items():
            axis.plot(*track.T, label=name, **STYLES.get(name, {}))
        axis.set_aspect("equal", adjustable="datalim" if axis is axes else "box")
    title = "Tracks"
    if inset is not None:
        centre = truth[len(truth) * 2 // 3]
        inset.set(xlim=centre[0] + np.array((-INSET_M, INSET_M)), ylim=centre[1] + np.array((-INSET_M, INSET_M)))
        inset.set(xticks=[], yticks=[])
        axes.indicate_inset_zoom(inset, edgecolor="#555555")
        title = f"Tracks (enlarged: {2 * INSET_M:.0f} m)"
    axes.set(xlabel="east, m", ylabel="north, m", title=title)
    axes.grid(alpha=0.25)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.07), ncols=6, fontsize=9)


def _emptiest_corner(points: Points) -> tuple[int, int]:
    """Corner in which the inset hides the least: 0 or 1 along each axis."""
    low, high = points.min(axis=0), points.max(axis=0)
    share = (points - low) / np.maximum(high - low, 1e-9)
    return min(CORNERS, key=lambda corner: int(np.sum(np.all(np.abs(share - np.array(corner)) < 0.5, axis=1))))


def _draw_errors(axes: Any, score: Score, sources: dict[str, Errors], names: list[str]) -> None:
    """RMS in windows of 20 s, log scale: raw and filtered differ by a factor of ten and more."""
    for name in names:
        errors = sources.get(name)
        if errors is None or not errors.t_ns:
            continue
        windows = np.floor((np.array(errors.t_ns) - score.reference.start_ns) / NS_PER_S / WINDOW_S).astype(int)
        counts = np.bincount(windows)
        sums = np.bincount(windows, weights=np.square(errors.error))
        filled = counts > 0
        centres_s = (np.arange(len(counts))[filled] + 0.5) * WINDOW_S
        axes.plot(centres_s, np.sqrt(sums[filled] / counts[filled]), label=name, **STYLES.get(name, {}))
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in "25" else "")
    axes.grid(alpha=0.25, which="both")
    axes.legend(loc="best", ncols=2, fontsize=9)
