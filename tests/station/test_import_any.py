"""The readers of foreign recordings: never an exception nor a wrong value, whatever a line holds."""

import json
from array import array
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from common.boat_config import BoatTable
from common.codec import encode_frame
from common.errors import WayfixError
from common.messages import Fix, Heading, TurnRate
from common.simulation.column_map import ColumnMap, FixColumns, HeadingColumns, ImuColumns, TimeColumn
from common.units import NS_PER_S
from shore.imports import frames as cut
from shore.imports.columns import ColumnReader
from shore.imports.gpsd import GpsdReader
from shore.imports.line_counts import Rejected
from shore.imports.reader import Lines, RecordingReader
from shore.imports.record_times import NO_TIME, Plan
from shore.imports.signalk import SELF, SignalKReader, own_contexts
from shore.imports.values import utc_ns_of
from tests.station.imports import ISO, T0, iso, tpv

JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)
NUMBER = st.floats(-400, 400) | JUNK
TIME = st.integers(0, 59).map(lambda second: iso(second - 20)) | JUNK
OBJECT = st.fixed_dictionaries(
    {"class": st.sampled_from(["TPV", "ATT", "IMU"])},
    optional={
        "time": TIME,
        "device": JUNK,
        **dict.fromkeys(("lat", "lon", "altMSL", "speed", "track", "mode", "status"), NUMBER),
        **dict.fromkeys(("heading", "mheading", "pitch", "roll", "yaw", "rot", "acc_x", "acc_y", "gyro_z"), NUMBER),
    },
)
VALUE = st.fixed_dictionaries(
    {},
    optional={
        "path": st.sampled_from(
            [f"navigation.{name}" for name in ("position", "headingTrue", "attitude", "rateOfTurn")]
        )
        | JUNK,
        "value": NUMBER
        | st.fixed_dictionaries({}, optional={"latitude": NUMBER, "longitude": NUMBER, "roll": NUMBER, "yaw": NUMBER}),
    },
)
UPDATE = st.fixed_dictionaries(
    {},
    optional={"$source": JUNK, "source": JUNK, "timestamp": TIME, "values": st.lists(VALUE | JUNK, max_size=3) | JUNK},
)
DELTA = st.fixed_dictionaries(
    {}, optional={"context": st.just(SELF) | JUNK, "updates": st.lists(UPDATE | JUNK, max_size=3) | JUNK}
)


def lines_of(content: st.SearchStrategy[Any]) -> st.SearchStrategy[list[str]]:
    good = content.map(json.dumps)
    cut_short = st.tuples(good, st.integers(0, 200)).map(lambda pair: pair[0][: pair[1]])
    stamped = good.map(lambda line: f"1700000000000;I;{line}")
    return st.lists(good | good | cut_short | stamped | st.text(max_size=20), max_size=12)


class Given(Lines):
    """Lines without a file."""

    def __init__(self, lines: list[str]) -> None:
        self._given = [line for text in lines for line in text.splitlines() if line.strip()]

    def __iter__(self) -> Any:
        return iter(self._given)


def through(first: RecordingReader, second: RecordingReader) -> None:
    """A whole import up to the frames' bytes: the codec refuses every value that is out of its range."""
    times, config = array("q"), []
    for record in first.records():
        times.append(NO_TIME if record.t_ns is None else record.t_ns)
        config += list(first.measure(record, record.t_ns or 0))
    rates = cut.survey(cut.Placed(measurement, 0, 0) for measurement in config)
    boat = cut.boat_config(first.boat, first.sensors(rates), None)
    second.sources = first.sources
    plan = Plan(times, 1.0)

    def placed() -> Any:
        for number, record in enumerate(second.records()):
            t_ns = plan.at(number)
            if t_ns is None:
                second.leave_out(record, "no time")
                continue
            for measurement in second.measure(record, t_ns):
                yield cut.Placed(measurement, plan.shift_ns(number), plan.epoch(number))

    identity = cut.identity_of(cut.greeting_of(boat, "", {}))
    known = {table.id for table in boat.sensor}
    for frame in cut.frames_of(placed(), boat, identity, cut.RecordingClock("rtc", 1)):
        encode_frame(frame)
        assert {one.sensor for name in ("fixes", "headings", "attitudes") for one in getattr(frame, name)} <= known


@example([json.dumps({"class": "TPV", "time": "2020-01-01T00:00:00Z", "mode": 0.5})])
@given(lines_of(OBJECT))
def test_any_gpsd_lines_are_read_without_an_exception(lines: list[str]) -> None:
    second = GpsdReader(Given(lines))
    through(GpsdReader(Given(lines)), second)
    assert second.account.total == len(list(Given(lines)))


@given(lines_of(DELTA))
def test_any_deltas_are_read_without_an_exception(lines: list[str]) -> None:
    try:
        own = own_contexts(Given(lines), None, "a.log")
    except WayfixError:  # several vessels: any of them will do
        own = (SELF,)
    through(SignalKReader(Given(lines), own), SignalKReader(Given(lines), own))


@given(
    lat=st.floats(-90, 90), lon=st.floats(-180, 180), speed=st.floats(0, 500), track=st.floats(0, 360),
    heading=st.floats(0, 359.999), turn=st.floats(-100, 100), number=st.integers(1, 5),
)  # fmt: skip
def test_what_is_taken_is_what_was_said(
    lat: float, lon: float, speed: float, track: float, heading: float, turn: float, number: int
) -> None:
    said = [
        tpv(number, lat=lat, lon=lon, speed=speed, track=track),
        json.dumps({"class": "ATT", "time": iso(number), "heading": heading, "rot": turn}),
    ]
    reader = GpsdReader(Given(said))
    records = list(reader.records())
    fix, compass, rate = [item for record in records for item in reader.measure(record, record.t_ns or 0)]
    assert isinstance(fix, Fix)
    assert isinstance(compass, Heading)
    assert isinstance(rate, TurnRate)
    assert (fix.lat_deg, fix.lon_deg, fix.t_ns) == (lat, lon, T0 + number * NS_PER_S)
    assert fix.sog_kn == pytest.approx(speed * 3600 / 1852)
    assert fix.cog_true_deg == pytest.approx(track % 360)
    assert compass.heading_true_deg == pytest.approx(heading)
    assert rate.rate_deg_s == pytest.approx(turn / 60)


@given(st.text(max_size=30) | st.datetimes().map(lambda moment: moment.isoformat()))
def test_any_text_for_a_time(text: str) -> None:
    try:
        found = utc_ns_of(text)
    except Rejected:
        return
    assert found is not None
    assert 0 <= found < 2**63


def test_times_with_zones_and_leap_seconds() -> None:
    assert utc_ns_of(ISO) == utc_ns_of("2023-11-15T00:13:20+02:00") == utc_ns_of("2023-11-14 22:13:20") == T0
    assert utc_ns_of("2016-12-31T23:59:60Z") == utc_ns_of("2017-01-01T00:00:00Z")
    assert utc_ns_of("2023-11-14T22:13:20.123456789Z") == T0 + 123_456_000


FIELD = st.sampled_from(["", "nan", "1e400", "x", "-0", "1,5", "\u0661", "1700000000", "200", "60.5"]) | st.text(
    max_size=6
)


@given(rows=st.lists(st.lists(FIELD, max_size=6), min_size=1, max_size=8), delimiter=st.sampled_from([",", ";"]))
def test_any_rows_of_a_table_are_read_without_an_exception(
    rows: list[list[str]], delimiter: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    mapping = ColumnMap(
        boat=BoatTable(id="b"),
        time=TimeColumn(column="t", unix=True),
        fix=FixColumns(lat="lat", lon="lon", sog="v"),
        heading=HeadingColumns(column="psi"),
        imu=ImuColumns(yaw_rate="r", accel_fwd="v", accel_stb="psi"),
    )
    path = tmp_path_factory.mktemp("table") / "in.csv"
    head = ["t", "lat", "lon", "v", "psi", "r"]
    text = "\n".join(delimiter.join(row) for row in [head, ["1"] * 6, ["2"] * 6, ["3"] * 6, *rows])
    path.write_text(text, encoding="utf-8", errors="replace")
    try:
        readers = ColumnReader(path, mapping), ColumnReader(path, mapping)
    except WayfixError:  # quotes and blanks that leave no table
        return
    through(*readers)
    total = readers[1].accounts[0].total
    assert all(account.total <= total for account in readers[1].accounts[1:])
