"""Pictures of a result: tracks, headings, RMS errors over time, and R with what moves it. Needs matplotlib (`report`).

All show the first of the runs, but for the lower row of the RMS errors, which is over all runs.
"""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from common.errors import WayfixError
from common.words import counted, how_to_install
from shore.lab.batch import RunTrack
from shore.lab.parallel_runs import RAW, Result
from shore.lab.statistics import running_rms, squared_errors, window_variance
from shore.navigation.numbers import Array, wrapped
from shore.navigation.state_space import HEADING
from shore.report.run_picture import STYLES

WINDOW: Final = 30
"""Number of errors N in the window of Eq. 5.24 for the actual R."""
ENLARGED_M: Final = 35.0
"""Half width of the enlarged piece of track, m."""
ENLARGED_S: Final = 60.0
AXES: Final = ("east", "north", "heading")
UNITS: Final = ("m", "m", "deg")
LAB_STYLES: Final[dict[str, dict[str, Any]]] = {
    **STYLES,
    RAW: {"color": "#9db4c8", "linewidth": 1.4},
    "ekf": {"color": "#7a5195", "linewidth": 1.3, "linestyle": (0, (1, 1.5))},
    "oracle": {"color": "#2f6fdb", "linewidth": 1.3, "linestyle": (0, (4, 1.5, 1, 1.5))},
    "oracle-8": {"color": "#12a3b4", "linewidth": 1.3, "linestyle": (0, (4, 1.5, 1, 1.5))},
    "iae": {"color": "#8c564b", "linewidth": 1.3},
    "rae": {"color": "#c49c94", "linewidth": 1.3},
    "imm": {"color": "#17becf", "linewidth": 1.3},
    "fuzzy-qr": {"color": "#e377c2", "linewidth": 1.3},
    "interval-kf": {"color": "#bcbd22", "linewidth": 1.3},
    "dead-reckoning": {"color": "#7f7f7f", "linewidth": 1.3},
    "static": {"color": "#a0006d", "linewidth": 1.5},
    "ukf-5": {"color": "#98df8a", "linewidth": 1.3},
}
HEIGHTS_IN: Final = {"tracks": 6.2, "headings": 5.4, "rms": 5.4, "noise": 7.0}
DRAWN_FIRST: Final = ("kf", "fuzzy-thesis")
"""Methods that are drawn first, as wide lines, because others may lie upon them."""
DRAWN_LAST: Final = "fuzzy"
TRUTH: Final[dict[str, Any]] = {"color": "#222222", "linewidth": 2.0}
BOUND: Final[dict[str, Any]] = {"color": "#222222", "linewidth": 1.2, "linestyle": (0, (1, 1))}
COAST: Final[dict[str, Any]] = {"color": "#a08050", "linewidth": 2.5, "alpha": 0.7}


@dataclass(frozen=True, slots=True)
class Picture:
    """A finished figure."""

    kind: str
    """`tracks`, `headings`, `rms` or `noise`: part of the file's name."""
    caption: str
    png: bytes


def pictures(result: Result, filters: tuple[str, ...] | None = None) -> Iterator[Picture]:
    """All figures of a result with these filters (default: those asked for). Raises WayfixError without matplotlib."""
    plt = pyplot()
    shown = sorted(filters or result.asked, key=lambda name: (name not in DRAWN_FIRST, name == DRAWN_LAST))
    kinds = [("tracks", _tracks), ("headings", _headings), ("rms", _rms)]
    if _adaptive(result, shown):
        kinds.append(("noise", _noise))
    for kind, draw in kinds:
        figure = plt.figure(figsize=(11, HEIGHTS_IN[kind]), dpi=100, layout="constrained")
        caption = draw(figure, result, shown)
        figure.suptitle(_one_run(result), fontsize=10, color="#555555")
        file = io.BytesIO()
        figure.savefig(file, format="png")
        plt.close(figure)
        yield Picture(kind, caption, file.getvalue())


def save_figures(result: Result, directory: Path) -> Iterator[Path]:
    """Write the figures of a result as `<scenario>-<profile>-<kind>.png`."""
    for picture in pictures(result):
        path = directory / f"{result.name}-{result.setting.profile}-{picture.kind}.png"
        path.write_bytes(picture.png)
        yield path


def pyplot() -> Any:
    """matplotlib, drawing into memory. Raises WayfixError when it is missing: ask before the long work begins."""
    try:
        import matplotlib as mpl
    except ModuleNotFoundError as error:
        raise WayfixError("matplotlib is missing, so there are no pictures", cure=how_to_install("report")) from error
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    return plt


def _one_run(result: Result) -> str:
    return (
        f"Scenario {result.name} (simulation), first of {counted(result.runs, 'run')}, seed {result.seed}, "
        f"profile {result.setting.profile}"
    )


def _first(result: Result, method: str) -> RunTrack:
    track = result.outcomes[method].first
    assert track is not None
    return track


def _adaptive(result: Result, shown: list[str]) -> list[str]:
    """Filters that have a degree of matching, or change R otherwise."""

    def moves(track: RunTrack) -> bool:
        return bool(np.any(np.isfinite(track.dom_ratio))) or bool(np.nanmax(np.abs(track.alpha - 1.0), initial=0.0) > 0)

    return [name for name in shown if name != result.setting.reference and moves(_first(result, name))]


def _legend(figure: Any, axes: Any) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 8), frameon=False, fontsize=9)


def _turn(truth: Array) -> int:
    """The middle of the longest turn, or of the run on a straight line."""
    turning = np.abs(np.diff(truth[:, HEADING])) > np.radians(0.5)
    if not turning.any():
        return len(truth) // 2
    edges = np.flatnonzero(np.diff(np.concatenate(([0], turning.astype(int), [0]))))
    starts, stops = edges[::2], edges[1::2]
    longest = int(np.argmax(stops - starts))
    return int(starts[longest] + stops[longest]) // 2


def _tracks(figure: Any, result: Result, shown: list[str]) -> str:
    runs, scenario = result.setting.runs, result.setting.scenario
    truth = runs.truth
    whole, enlarged = figure.subplots(1, 2, width_ratios=(1.25, 1))
    fixes = _first(result, RAW).x[1:, :2]
    for axes in (whole, enlarged):
        if scenario.coast:
            axes.plot(*np.array(scenario.coast).T, label="coast (schematic)", **COAST)
        axes.plot(*fixes.T, ".", color=LAB_STYLES[RAW]["color"], markersize=3, label="GPS fixes")
        axes.plot(*truth[:, :2].T, label="truth (start: dot)", marker="o", markevery=[0], **TRUTH)
        for name in shown:
            axes.plot(*_first(result, name).x[:, :2].T, label=name, **LAB_STYLES.get(name, {}))
        axes.set(xlabel="east, m")
        axes.grid(alpha=0.25)
    points = np.vstack((fixes, truth[:, :2], np.array(scenario.coast).reshape(-1, 2)))
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    margin = 0.04 * float(np.max(high - low))
    whole.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin), ylabel="north, m")
    whole.set_aspect("equal")
    east, north = truth[_turn(truth), :2]
    half = min(ENLARGED_M, 0.2 * float(np.max(high - low)))
    enlarged.set(
        xlim=(east - half, east + half), ylim=(north - half, north + half), title=f"enlarged: {2 * half:.0f} m"
    )
    enlarged.set_aspect("equal")
    whole.indicate_inset((east - half, north - half, 2 * half, 2 * half), edgecolor="#222222")
    _legend(figure, whole)
    coast = " The coast line is our own schematic stand-in." if scenario.coast else ""
    return f"{_one_run(result)}.{coast}"


def _headings(figure: Any, result: Result, shown: list[str]) -> str:
    """Each line near the truth, so that nothing jumps at north."""
    runs = result.setting.runs
    truth = runs.truth[:, HEADING]
    whole, enlarged = figure.subplots(1, 2, width_ratios=(1.6, 1))

    def degrees(x: Array) -> Array:
        near: Array = np.degrees(truth + wrapped(x[:, HEADING] - truth))
        return near

    compass = degrees(_first(result, RAW).x)[1:]
    middle = runs.t_s[_turn(runs.truth)]
    zoom = np.abs(runs.t_s - middle) <= 0.5 * ENLARGED_S
    for axes in (whole, enlarged):
        axes.plot(runs.t_s[1:], compass, ".", color=LAB_STYLES[RAW]["color"], markersize=3, label="compass")
        axes.plot(runs.t_s, np.degrees(truth), label="truth", **TRUTH)
        for name in shown:
            axes.plot(runs.t_s, degrees(_first(result, name).x), label=name, **LAB_STYLES.get(name, {}))
        axes.set(xlabel="time, s")
        axes.grid(alpha=0.25)
    shown_there = np.concatenate((compass[zoom[1:]], np.degrees(truth[zoom])))
    low, high = np.nanmin(shown_there), np.nanmax(shown_there)
    enlarged.set(xlim=(middle - 0.5 * ENLARGED_S, middle + 0.5 * ENLARGED_S), ylim=(low - 1.0, high + 1.0))
    enlarged.set(title=f"enlarged: {ENLARGED_S:.0f} s")
    whole.set(ylabel="heading, deg from true north (continued across north)")
    _legend(figure, whole)
    return f"{_one_run(result)}."


def _rms(figure: Any, result: Result, shown: list[str]) -> str:
    grid = figure.subplots(2, 3, sharex=True)
    runs = result.setting.runs
    times = runs.t_s[1:]
    for place in range(3):
        upper, lower = grid[:, place]
        for name in (RAW, *shown):
            label = "raw sensors" if name == RAW else name
            own = squared_errors(_first(result, name).x - runs.truth, np.zeros(5))[1:, place]
            given = np.isfinite(own)
            style = LAB_STYLES.get(name, {})
            upper.plot(times[given], running_rms(own[given]), label=label, **style)
            lower.plot(times, np.sqrt(result.outcomes[name].squares[1:, place] / result.runs), **style)
        lower.plot(times, np.sqrt(result.bound[1:, place]), **BOUND)
        upper.plot([], [], label="bound", **BOUND)
        upper.set(title=f"{AXES[place]}, {UNITS[place]}")
        lower.set(xlabel="time, s")
        for axes in (upper, lower):
            _plain_log(axes)
    grid[0, 0].set(ylabel="one run, RMS so far")
    grid[1, 0].set(ylabel=f"RMS over {result.runs} runs")
    _legend(figure, grid[0, 0])
    return (
        f"{_one_run(result)}: RMS error of all steps so far, as the thesis draws it (upper row). "
        f"RMS error of each step over all {result.runs} runs, and the posterior Cramer-Rao bound (lower row)."
    )


def _noise(figure: Any, result: Result, shown: list[str]) -> str:
    """R fixed, adapted and actual (Eqs 5.24, 5.25); degree of matching; alpha."""
    runs, units = result.setting.runs, np.array([1.0, 1.0, np.degrees(1.0) ** 2])
    adaptive = _adaptive(result, shown)
    raw = _first(result, RAW).x - runs.truth
    errors = np.column_stack((raw[:, :2], np.asarray(wrapped(raw[:, HEADING]))))[1:]
    actual = window_variance(errors, WINDOW) * units
    true = np.square(np.column_stack((runs.gps_m, runs.compass_sigma_rad)))[1:] * units
    told = result.setting.told
    fixed = np.square([told.gps_east_m, told.gps_north_m, told.compass_deg])
    grid = figure.subplots(3, 3, sharex=True, height_ratios=(1.5, 1, 1))
    times = runs.t_s[1:]
    for place in range(3):
        upper, middle, lower = grid[:, place]
        upper.axhline(fixed[place], color="#2f6fdb", linewidth=1.4, label="fixed R")
        full = slice(WINDOW - 1, None)
        label = f"actual R (Eq. 5.24, N = {WINDOW})"
        upper.plot(times[full], actual[full, place], label=label, **{**TRUTH, "linewidth": 1.3})
        upper.plot(times, true[:, place], label="true variance", **BOUND)
        for name in adaptive:
            track, style = _first(result, name), {**LAB_STYLES.get(name, {}), "linewidth": 1.3}
            upper.plot(times, track.variance[1:, place] * units[place], label=f"R of {name}", **style)
            middle.plot(times, track.dom_ratio[1:, place], **style)
            lower.plot(times, track.alpha[1:, place], **style)
        upper.set(title=f"{AXES[place]}, {UNITS[place]}²")
        lower.set(xlabel="time, s")
        for axes in (upper, middle, lower):
            _plain_log(axes)
    for row, label in enumerate(("R", "degree of matching", "alpha")):
        grid[row, 0].set(ylabel=label)
    _legend(figure, grid[0, 0])
    return f"{_one_run(result)}: R, the degree of matching (Eq. 5.10) and the factor alpha (Eq. 5.11) of each channel."


def _plain_log(axes: Any) -> None:
    """Log scale with plain numbers at 1, 2 and 5."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter(lambda x, _: f"{x:g}" if f"{x:e}"[0] in "25" else "")
    axes.grid(alpha=0.25, which="both")
