"""The picture of a trip: its track is in it, whatever the trip."""

from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib.image as mpl_image
import numpy as np
import pytest

from common.events import event
from common.geodesy import LocalPlane
from shore.exports.png import SHOWN, _Thinned
from shore.report.trip_picture import TripPlot, draw
from tests.station.exporting import (
    NS,
    UTC_NS,
    estimate,
    export,
    log_of,
)


def trip_of(rows: np.ndarray, **more: Any) -> TripPlot:
    defaults: dict[str, Any] = {
        "title": "cost $5 and $6_", "subtitle": "海上試験", "has_utc": True, "origin": (50.0, -1.0),
        "fixes": rows[::5, 1:3],
    }  # fmt: skip
    return TripPlot(rows=rows, **(defaults | more))


def straight(count: int = 200, spread_m: float = 1000.0) -> np.ndarray:
    along = np.linspace(0.0, 1.0, count)
    rows = np.column_stack((1.8e9 + 60.0 * along, spread_m * along, 0.3 * spread_m * along, *[along] * 7))
    rows[:, 3:] = (350.0, 4.0, 1.0, 9.0, 0.5, 1.0, 0.0)
    rows[0, 9] = 1.0
    return rows


@pytest.mark.parametrize(
    "rows",
    [
        straight(),
        straight(1),
        straight(spread_m=0.0),
        straight(spread_m=300_000.0),
        np.column_stack((straight()[:, :4], np.full((200, 4), np.nan), straight()[:, 8:])),
    ],
)
def test_a_picture_of_any_trip_has_its_track_in_it(rows: np.ndarray) -> None:
    for has_utc in (True, False):
        stream = BytesIO()
        draw(stream, trip_of(rows, has_utc=has_utc))
        stream.seek(0)
        image = mpl_image.imread(stream)
        red = np.array((0xD6, 0x28, 0x39)) / 255.0
        drawn = np.abs(image[:, :, :3] - red).max(axis=2) < 0.02
        assert image.shape[1] == 1320
        assert drawn.sum() > 20


def test_a_long_trip_is_thinned_and_keeps_its_pieces() -> None:
    thinned = _Thinned()
    for number in range(5 * SHOWN):
        thinned.add((float(number), *[0.0] * 8, float(number == 33_333)))
    points = thinned.points(10)
    assert SHOWN <= len(points) <= 2 * SHOWN
    steps = np.diff(points[:, 0])
    assert steps.min() == steps.max()
    (begins,) = points[points[:, 9] == 1.0, 0]
    assert abs(begins - 33_333) <= 4


def test_a_picture_of_a_log_has_right_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from shore.exports import png

    drawn: list[TripPlot] = []
    monkeypatch.setattr(png, "draw", lambda _stream, trip: drawn.append(trip))
    items: list[Any] = [estimate(t_s, 50.0 + t_s / 1e4, -1.0) for t_s in range(1, 5)]
    items.append(event("link-lost", 3 * NS, "link", age_s=3.5))
    assert export(log_of(tmp_path / "log.mcap", items), "--to", "png", tmp_path / "a.png") == 0
    (trip,) = drawn
    plane = LocalPlane(*trip.origin)
    assert trip.origin == (items[0]["lat_deg"], items[0]["lon_deg"])
    for row, item in zip(trip.rows, items, strict=False):
        assert (row[1], row[2]) == pytest.approx(plane.to_east_north_m(item["lat_deg"], item["lon_deg"]), abs=1e-6)
        assert tuple(row[4:7]) == (4.0, 0.5, 9.0)
        assert row[0] == pytest.approx((UTC_NS + item["t_ns"]) / NS)
    (happening,) = trip.events
    assert happening.code == "link-lost"
    assert happening.north_m == pytest.approx(trip.rows[2, 2])
