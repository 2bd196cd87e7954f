"""Track plot of a trip: its track with fixes, error ellipses and events; under it heading and sigmas over time."""

from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, BinaryIO, Final
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray

from common.units import NS_PER_S

Points = NDArray[np.float64]

COLOURS: Final = {"fixes": "#9db4c8", "track": "#d62839", "doubt": "#2f6fdb", "heading": "#222222", "grey": "#777777"}
STRETCHES: Final = ("not aligned", "fix", "coasting")
"""What a row rests on."""
GROUNDS: Final = {"not aligned": "#bbbbbb", "coasting": "#f2b36b"}
LEVELS: Final = {"info": "#2a8ae0", "warning": "#e9861b", "error": "#a0006d"}
ELLIPSES: Final = 14
"""Least number of error ellipses along the track."""
LABELS: Final = 8
"""Most warnings and errors that are named in the track; the others are marked only."""
TWO_SIGMA: Final = 2.0
NARROW_M: Final = 2.0
"""Least half width of the track's picture, m."""


@dataclass
class TripPlot:
    """What is drawn, in order of time."""

    title: str
    subtitle: str
    has_utc: bool
    """True = times are UTC in s since 1970; False = they are seconds of the log."""
    origin: tuple[float, float]
    """Latitude and longitude of the point east = north = 0, deg."""
    rows: Points
    """Rows (n, 10): time (s), east, north (m), heading (deg), variance east, covariance, variance north (m^2), sigma
    heading (deg), place in `STRETCHES`, first of a piece."""
    fixes: Points
    """Positions of the fixes (m, 2): east, north, m."""
    direction: str = "true heading, deg"
    """Label of the heading in `rows`."""
    events: list["Happening"] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Happening:
    """One event in the picture."""

    time: float
    level: str
    code: str
    east_m: float | None
    north_m: float | None


def draw(stream: BinaryIO, trip: TripPlot) -> None:
    """Write a PNG; raises ImportError when matplotlib is missing, OSError."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    has_sigma = bool(np.isfinite(trip.rows[:, 4]).any())
    figure = plt.figure(figsize=(12, 11 if has_sigma else 9), dpi=110, layout="constrained")
    grid = figure.add_gridspec(3 if has_sigma else 2, 1, height_ratios=(3.4, 1, 1) if has_sigma else (3.4, 1))
    figure.suptitle(_printable(trip.title), fontsize=14, parse_math=False)
    track = figure.add_subplot(grid[0])
    _draw_track(track, trip)
    track.set_title(_printable(trip.subtitle), fontsize=10, color=COLOURS["grey"], parse_math=False)
    below = heading = figure.add_subplot(grid[1])
    _draw_heading(heading, trip)
    _draw_times(heading, trip)
    if has_sigma:
        below = figure.add_subplot(grid[2], sharex=heading)
        _draw_sigma(below, trip)
        _draw_times(below, trip)
        heading.tick_params(labelbottom=False)
        heading.xaxis.get_offset_text().set_visible(False)
    below.set_xlabel("UTC" if trip.has_utc else "time, s")
    with catch_warnings():
        simplefilter("ignore", UserWarning)  # a name in letters that matplotlib's font lacks shows boxes
        figure.savefig(stream, format="png", metadata={"Software": "wayfix"})
    plt.close(figure)


def _draw_track(axes: Any, trip: TripPlot) -> None:
    from matplotlib.patches import Ellipse

    east, north = _broken(trip.rows, trip.rows[:, 1]), _broken(trip.rows, trip.rows[:, 2])
    if len(trip.fixes):
        axes.plot(*trip.fixes.T, ".", color=COLOURS["fixes"], markersize=4, label="GPS fixes", zorder=1)
    line = {"color": COLOURS["track"], "linewidth": 1.6, "zorder": 3}
    is_coasting = trip.rows[:, 8] == STRETCHES.index("coasting")
    axes.plot(np.where(is_coasting, np.nan, east), north, **line, label="track")
    if is_coasting.any():
        axes.plot(np.where(is_coasting, east, np.nan), north, **line, linestyle=":", label="coasting: no fix")
    known = np.flatnonzero(np.isfinite(trip.rows[:, 4:7]).all(axis=1))
    for place, index in enumerate(_apart(trip.rows, known[_evenly(trip.rows[known, 1:3], ELLIPSES)])):
        width, height, angle_deg = _ellipse(*trip.rows[index, 4:7])
        ellipse = Ellipse(
            tuple(trip.rows[index, 1:3]), width, height, angle=angle_deg, zorder=2,
            facecolor=(*_rgb(COLOURS["doubt"]), 0.12), edgecolor=COLOURS["doubt"], linewidth=0.9,
            label=None if place else "2-sigma, true to scale",
        )  # fmt: skip
        axes.add_patch(ellipse)
    ends = trip.rows[[0, -1], 1:3]
    for place, marker, label in zip(ends, ("o", "s"), ("begin", "end"), strict=True):
        axes.plot(
            *place, marker, color="white", markeredgecolor=COLOURS["heading"], markersize=8, zorder=5, label=label
        )
    _mark_events(axes, trip)
    _frame(axes, trip)
    axes.grid(alpha=0.25)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=9, frameon=False)


def _mark_events(axes: Any, trip: TripPlot) -> None:
    """All as diamonds; warnings and errors by name where there is room."""
    shown_m = float(np.hypot(*np.ptp(trip.rows[:, 1:3], axis=0)))
    largest_m2 = float(np.nanmax(trip.rows[:, 4:7:2], initial=0.0))
    near_m = 0.08 * max(shown_m, 2.0 * TWO_SIGMA * largest_m2**0.5)
    named: list[Points] = []
    for level, colour in reversed(LEVELS.items()):
        these = [each for each in trip.events if each.level == level and each.east_m is not None]
        if not these:
            continue
        places = np.array([(each.east_m, each.north_m) for each in these], dtype=np.float64)
        axes.plot(*places.T, "D", color=colour, markersize=5, label=f"{level} ({len(these)})", zorder=4)
        for each, place in zip(these, places, strict=True):
            has_room = all(np.hypot(*(place - other)) > near_m for other in named)
            if level != "info" and has_room and len(named) < LABELS:
                named.append(place)
                axes.annotate(
                    each.code, place, xytext=(8, 6), textcoords="offset points", fontsize=8, color=colour, zorder=6
                )


def _frame(axes: Any, trip: TripPlot) -> None:
    """The limits of the picture: room about the track, with equal scales."""
    places = trip.rows[:, 1:3] if not len(trip.fixes) else np.vstack((trip.rows[:, 1:3], trip.fixes))
    low, high = places.min(axis=0), places.max(axis=0)
    middle, half = (low + high) / 2.0, np.maximum((high - low) / 2.0, NARROW_M)
    axes.update_datalim(np.vstack((middle - half, middle + half)))
    axes.margins(0.06)
    axes.set_aspect("equal", adjustable="datalim")
    unit, scale = ("km", 1000.0) if max(half) > 5000.0 else ("m", 1.0)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(lambda value, _: f"{value / scale:g}")
    lat_deg, lon_deg = trip.origin
    axes.set_xlabel(f"{unit} east of {abs(lon_deg):.5f}° {'W' if lon_deg < 0.0 else 'E'}")
    axes.set_ylabel(f"{unit} north of {abs(lat_deg):.5f}° {'S' if lat_deg < 0.0 else 'N'}")


def _draw_heading(axes: Any, trip: TripPlot) -> None:
    heading = trip.rows[:, 3]
    if not np.isfinite(heading).any():
        axes.text(0.5, 0.5, "not known", transform=axes.transAxes, ha="center", color=COLOURS["grey"])
    turns = np.concatenate(((False,), np.abs(np.diff(heading)) > 180.0))  # through north: no line across the picture
    axes.plot(_times(trip), np.where(_first(trip) | turns, np.nan, heading), color=COLOURS["heading"], linewidth=1.0)
    axes.set(ylabel=trip.direction, ylim=(0.0, 360.0), yticks=range(0, 361, 90))
    axes.grid(alpha=0.25)


def _draw_sigma(axes: Any, trip: TripPlot) -> None:
    position = _broken(trip.rows, np.sqrt(trip.rows[:, 4] + trip.rows[:, 6]))
    heading = _broken(trip.rows, trip.rows[:, 7])
    lines = axes.plot(_times(trip), position, color=COLOURS["doubt"], linewidth=1.3, label="position, m")
    axes.set(ylabel="1-sigma position, m")
    axes.yaxis.label.set_color(COLOURS["doubt"])
    axes.set_ylim(0.0, _top(position))
    other = axes.twinx()
    lines += other.plot(_times(trip), heading, color=LEVELS["warning"], linewidth=1.3, label="heading, deg")
    other.set_ylabel("1-sigma heading, deg", color=LEVELS["warning"])
    other.set_ylim(0.0, _top(heading))
    axes.grid(alpha=0.25)


def _draw_times(axes: Any, trip: TripPlot) -> None:
    """Events as lines; a ground of its own where the position was not aligned yet, and where there was no fix."""
    for each in trip.events:
        if each.level in LEVELS:
            time = _utc(np.array([each.time]))[0] if trip.has_utc else each.time
            axes.axvline(time, color=LEVELS[each.level], linewidth=1.0, alpha=0.55, zorder=0)
    low, high = axes.get_ylim()
    grounds = []
    for stretch, colour in GROUNDS.items():
        here = trip.rows[:, 8] == STRETCHES.index(stretch)
        if here.any():
            look = {"color": colour, "alpha": 0.35, "linewidth": 0, "zorder": 0}
            grounds.append(axes.fill_between(_times(trip), low, high, where=here, label=stretch, **look))
    if grounds:
        axes.legend(handles=grounds, loc="upper right", fontsize=8)
    axes.set_ylim(low, high)
    if trip.has_utc:
        from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

        locator = AutoDateLocator(tz=UTC)  # type: ignore[no-untyped-call]
        axes.xaxis.set_major_locator(locator)
        axes.xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=UTC))  # type: ignore[no-untyped-call]
    axes.margins(x=0.01)


def _times(trip: TripPlot) -> Any:
    return _utc(trip.rows[:, 0]) if trip.has_utc else trip.rows[:, 0]


def _utc(seconds: Points) -> Any:
    return (seconds * NS_PER_S).astype("int64").astype("datetime64[ns]")


def _first(trip: TripPlot) -> NDArray[np.bool_]:
    return np.asarray(trip.rows[:, 9] == 1.0)


def _broken(rows: Points, values: Points) -> Points:
    """A copy with NaN at the first row of each piece but the first, so that no line joins two pieces."""
    begins = rows[:, 9] == 1.0
    begins[0] = False
    return np.where(begins, np.nan, values)


def _top(values: Points) -> float:
    """Upper limit of the axis: a short beginning with a large sigma does not flatten the rest."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 1.0
    return float(max(min(finite.max(), 4.0 * np.quantile(finite, 0.9)) * 1.08, 1e-3))


def _evenly(places: Points, count: int) -> NDArray[np.intp]:
    """Indices at equal distances along a track, and at equal times of one that stands."""
    if not len(places):
        return np.empty(0, dtype=np.intp)
    along = np.concatenate(((0.0,), np.cumsum(np.hypot(*np.diff(places, axis=0).T))))
    wanted = np.linspace(0.0, along[-1], count + 2)[1:-1]
    return np.unique(np.clip(np.searchsorted(along, wanted), 0, len(places) - 1))


def _apart(rows: Points, indices: NDArray[np.intp]) -> list[int]:
    """Indices without those whose ellipse would lie upon the one before; of a boat that stands, the first few."""
    kept: list[int] = []
    for index in indices.tolist():
        size_m = TWO_SIGMA * np.sqrt(max(rows[index, 4], rows[index, 6]))
        before = rows[kept[-1], 1:3] if kept else np.array((np.inf, np.inf))
        was_m = TWO_SIGMA * np.sqrt(max(rows[kept[-1], 4], rows[kept[-1], 6])) if kept else 0.0
        if np.hypot(*(rows[index, 1:3] - before)) > 0.5 * size_m or not 0.6 * was_m < size_m < 1.7 * was_m:
            kept.append(index)
    return kept


def _ellipse(east: float, cross: float, north: float) -> tuple[float, float, float]:
    """Width, height (2 x 2 sigma, m) and angle of the first, deg anticlockwise from east."""
    values, vectors = np.linalg.eigh(np.array(((east, cross), (cross, north))))
    angle_deg = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
    small, large = 2.0 * TWO_SIGMA * np.sqrt(np.maximum(values, 0.0))
    return float(large), float(small), angle_deg


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _rgb(colour: str) -> tuple[float, float, float]:
    red, green, blue = (int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5))
    return red, green, blue


def when(utc_ns: int) -> str:
    """A time for the title."""
    return datetime.fromtimestamp(utc_ns // NS_PER_S, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
