"""One clock a recording: which leads, what the others are called, and that they change neither length nor UTC."""

import random
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.units import NS_PER_S
from onboard.recorded.convert import convert
from onboard.recorded.line_times import Schedule, sentence_times
from onboard.recorded.recording import pace, read_recording
from tests.acquire.sentences import sealed
from tests.acquire.test_convert import fixes_of, frames_of, write
from tests.acquire.test_sentence_time import HDG, VTG
from tests.cases import CASES, needs_cases

START = datetime(2026, 5, 12, 10, 8, tzinfo=UTC)
KINDS = ("RMC", "GGA", "GLL", "ZDA")


def said(talker: str, kind: str, utc: datetime, decimals: int = 2) -> bytes:
    """A sentence of a receiver that moves east."""
    time = utc.strftime("%H%M%S") + (f".{utc.microsecond // 10 ** (6 - decimals):0{decimals}}" if decimals else "")
    place = f"4213.8000,N,00844.{utc.minute * 60 + utc.second:04},W"
    match kind:
        case "RMC":
            return sealed(f"{talker}RMC,{time},A,{place},5.0,90.0,{utc:%d%m%y},,,A")
        case "GGA":
            return sealed(f"{talker}GGA,{time},{place},1,08,1.1,2.0,M,50.0,M,,")
        case "GLL":
            return sealed(f"{talker}GLL,{place},{time},A,A")
        case _:
            return sealed(f"{talker}ZDA,{time},{utc:%d,%m,%Y},00,00")


def stream(
    talker: str = "GP",
    start: datetime = START,
    count: int = 20,
    period_s: float = 1.0,
    kinds: Sequence[str] = ("RMC", "GGA"),
    others: Sequence[bytes] = (HDG,),
) -> list[bytes]:
    """A receiver's epochs, each followed by lines of other devices."""
    epochs = (start + timedelta(seconds=k * period_s) for k in range(count))
    return [line for utc in epochs for line in (*(said(talker, kind, utc) for kind in kinds), *others)]


def interleaved(a: Sequence[bytes], b: Sequence[bytes]) -> list[bytes]:
    return [line for pair in zip(a, b, strict=True) for line in pair]


def utc_of(schedule: Schedule) -> str | None:
    if schedule.first_utc_ms is None:
        return None
    return datetime.fromtimestamp(schedule.first_utc_ms / 1000, UTC).isoformat(timespec="milliseconds")[:-6]


@dataclass(frozen=True)
class Draw:
    """A good stream, and the same by another clock beside it."""

    lines: list[bytes]
    both: list[bytes]
    period_s: float


@st.composite
def streams(draw: st.DrawFn) -> Draw:
    """Any start, period and set of sentences; the copy is another talker's, -2 s to +12 h off."""
    period_s = draw(st.sampled_from([0.1, 0.2, 0.5, 1.0, 2.0, 5.0]))
    start = datetime(2026, 5, 12, tzinfo=UTC) + timedelta(seconds=draw(st.integers(0, 86_399)))
    kinds = ["RMC", *draw(st.lists(st.sampled_from(["GGA", "GLL", "ZDA"]), max_size=3, unique=True))]
    if draw(st.booleans()):
        kinds.reverse()
    others = draw(st.lists(st.sampled_from([HDG, VTG]), max_size=2))
    count = draw(st.integers(8, 25))
    shift_s = draw(
        st.one_of(
            st.integers(-200, 4_320_000).map(lambda hundredths: hundredths / 100),
            st.integers(-200, 2000).map(lambda hundredths: hundredths / 100),
            st.integers(1, 48).map(lambda quarters: quarters * 900.0),
            st.sampled_from([-2.0, -1.0, 18.0, 18.02, 0.04, 3600.02, 43_200.0]),
            st.integers(-2, 20).map(lambda periods: max(-2.0, periods * period_s)),
        )
    )
    talker, other = draw(st.sampled_from([("GP", "II"), ("GN", "GP"), ("II", "HC"), ("GP", "IN")]))
    copied = draw(st.sampled_from([kinds, kinds[:1], kinds[-1:]]))
    lines: list[bytes] = []
    both: list[bytes] = []
    is_lagging = draw(st.booleans())
    for k in range(count):
        utc = start + timedelta(seconds=k * period_s)
        own = [*(said(talker, kind, utc) for kind in kinds), *others]
        copies = [said(other, kind, utc + timedelta(seconds=shift_s)) for kind in copied]
        lines += own
        both += [*own, *copies] if is_lagging else [own[0], *copies, *own[1:]]
    return Draw(lines, both, period_s)


@settings(max_examples=150)
@given(streams())
def test_another_clock_changes_neither_length_nor_utc(drawn: Draw) -> None:
    alone, beside = sentence_times(drawn.lines), sentence_times(drawn.both)
    assert abs(beside.at_ns[-1] - alone.at_ns[-1]) <= drawn.period_s * NS_PER_S
    assert alone.first_utc_ms is not None
    assert beside.first_utc_ms == pytest.approx(alone.first_utc_ms, abs=drawn.period_s * 1000)


@pytest.mark.parametrize("every", [1, 5])
def test_a_receiver_leads_before_a_plotter_that_speaks_first_or_more_often(every: int) -> None:
    lines: list[bytes] = []
    for k in range(60):
        utc = START + timedelta(seconds=k)
        lines += [said("II", "RMC", utc + timedelta(hours=2)), *([] if k % every else [said("GP", "RMC", utc)])]
    first_ms = sentence_times(lines).first_utc_ms
    assert first_ms is not None
    assert first_ms == pytest.approx(START.timestamp() * 1000.0, abs=1000.0)  # of the plotter's line before it


@needs_cases
@pytest.mark.parametrize(
    ("name", "seconds", "first", "fixes", "words"),
    [
        (
            "shore/gll-local-time",
            19,
            "2026-05-12T10:08:00.000",
            20,
            "GPGLL gives local time, 2 h 00 min ahead of GPRMC",
        ),
        (
            "shore/zda-local-time",
            39,
            "2026-05-12T10:08:00.000",
            40,
            "IIZDA gives local time, 2 h 00 min ahead of GPRMC",
        ),
        ("shore/plotter-repeats", 100, "2026-05-12T10:08:00.000", 51, "IIRMC repeats times of GPRMC, up to 2 s old"),
        ("board/zda-two-seconds-ahead", 9, "2026-11-30T12:00:00.000", 10, "GPZDA is 2 s ahead of GPRMC"),
        ("board/gll-whole-seconds-5hz", 4, "2026-11-30T12:00:00.000", 20, "GPGLL gives whole seconds only"),
        ("shore/old-log-2014", 39, "2014-08-21T16:18:03.000", 40, None),
        ("shore/gps-outage", 399, "2026-05-12T10:08:00.000", 400, None),
    ],
)
def test_a_clock_that_does_not_lead_is_named_and_moves_nothing(
    name: str, seconds: float, first: str, fixes: int, words: str | None, tmp_path: Path
) -> None:
    source = CASES / f"{name}.nmea"
    schedule = pace(read_recording(source)).schedule
    assert schedule.at_ns[-1] / NS_PER_S == pytest.approx(seconds, abs=1.0)
    assert utc_of(schedule) == first
    assert schedule.gaps == ()
    summary = convert(source, tmp_path / "out")
    assert len(fixes_of(frames_of(tmp_path / "out"))) == fixes
    assert [note.startswith(words or "") for note in summary["notes"]] == [True] * bool(words)


def test_the_outage_of_a_receiver_that_goes_on_is_no_gap() -> None:
    lines = [
        said("GP", "RMC", START + timedelta(seconds=k)).replace(b",A,", b",V,", k in range(9, 30)) for k in range(40)
    ]
    assert sentence_times([sealed(line[1:-3].decode()) for line in lines]).at_ns[-1] == 39 * NS_PER_S


def later(**by: float) -> datetime:
    return START + timedelta(**by)


LATER = stream(start=later(minutes=30))


@pytest.mark.parametrize("talker", ["GP", "GN"])
def test_files_one_behind_the_other_in_either_order_are_one_recording(talker: str) -> None:
    first, second = stream(), stream(talker, later(minutes=30))
    one, other = sentence_times([*first, *second]), sentence_times([*second, *first])
    assert one.order is None
    assert other.order == (*range(len(second), len(second) + len(first)), *range(len(second)))
    for found in (one, other):
        assert found.at_ns[60] == 1800 * NS_PER_S
        assert [gap.line for gap in found.gaps] == [60]
        assert utc_of(found) == "2026-05-12T10:08:00.000"


def test_files_of_two_days_lie_days_apart() -> None:
    lines = [*stream(start=later(days=2, hours=-1)), *stream()]
    found = sentence_times(lines)
    assert utc_of(found) == "2026-05-12T10:08:00.000"
    assert found.at_ns[60] == (2 * 24 - 1) * 3600 * NS_PER_S


def test_files_that_overlap_are_merged() -> None:
    whole = stream(count=60)
    found = sentence_times([*whole[90:], *whole[:120]])
    assert found.at_ns[-1] == pytest.approx(59 * NS_PER_S, abs=NS_PER_S)
    assert utc_of(found) == "2026-05-12T10:08:00.000"


@pytest.mark.parametrize("reach", [4, 15, 1000])
def test_shuffled_lines_go_back_to_their_times(reach: int) -> None:
    lines = stream(count=100, kinds=["RMC"], others=[])
    mixed = sorted(range(100), key=lambda place: place + random.Random(place).uniform(0, reach))
    found = sentence_times([lines[place] for place in mixed])
    assert found.order is not None
    assert [mixed[place] for place in found.order] == list(range(100))
    assert found.at_ns == [k * NS_PER_S for k in range(100)]
    assert utc_of(found) == "2026-05-12T10:08:00.000"


def test_a_plotter_that_repeats_under_the_receivers_talker_is_told_apart() -> None:
    lines = [said("GP", "RMC", later(seconds=2 * (k // 2) - 2 * (k % 2))) for k in range(2, 80)]
    found = sentence_times(lines)
    assert found.at_ns[::2] == [2 * k * NS_PER_S for k in range(39)]
    assert utc_of(found) == "2026-05-12T10:08:02.000"
    words = "another GPRMC repeats times of GPRMC, up to 2 s old: its 39 sentences are not used"
    assert [clock.words() for clock in found.clocks] == [words]


@pytest.mark.parametrize("shift_s", [-2.0, 18.0, 7200.0])
def test_two_devices_of_one_talker_are_told_apart(shift_s: float) -> None:
    found = sentence_times(interleaved(stream(kinds=["RMC"]), stream("GP", later(seconds=shift_s), kinds=["RMC"])))
    assert found.at_ns[::4] == [k * NS_PER_S for k in range(20)]
    assert utc_of(found) == "2026-05-12T10:08:00.000"
    assert [clock.offset_s for clock in found.clocks] == [shift_s]


def test_of_two_receivers_that_differ_by_the_leap_seconds_the_one_behind_has_utc() -> None:
    found = sentence_times(interleaved(stream("GN", later(seconds=18)), stream("GP")))
    assert found.first_utc_ms == pytest.approx(1_000 * later().timestamp(), abs=600)  # what is before it has no time
    assert {(clock.kind, clock.offset_s) for clock in found.clocks} == {("gps-time", 18.0)}


def test_two_receivers_on_one_wire_are_both_used() -> None:
    found = sentence_times(interleaved(stream(), stream("GN")))
    assert found.at_ns[-1] == pytest.approx(19 * NS_PER_S, abs=NS_PER_S)
    assert found.clocks == ()


def test_a_receiver_that_changes_its_talker_is_one_clock() -> None:
    lines = [line for k in range(30) for line in stream("GN" if k % 5 else "GP", later(seconds=k), 1)]
    assert sentence_times(lines).at_ns[::3] == [k * NS_PER_S for k in range(30)]


def test_another_device_stands_in_where_the_leading_clock_is_silent() -> None:
    quiet = stream("II", later(seconds=20), 20, kinds=["GLL"])
    found = sentence_times([*interleaved(stream(), stream("II")), *quiet])
    assert found.at_ns[-1] == pytest.approx(39.5 * NS_PER_S, abs=NS_PER_S)
    assert found.gaps == ()


def test_a_date_that_comes_last_dates_the_whole() -> None:
    lines = stream(start=datetime(2026, 5, 11, 23, 59, 50, tzinfo=UTC), kinds=["GGA", "GLL"], others=[])
    found = sentence_times([*lines, said("GP", "ZDA", datetime(2026, 5, 12, 0, 0, 9, tzinfo=UTC))])
    assert utc_of(found) == "2026-05-11T23:59:50.000"
    assert found.at_ns[-1] == 19 * NS_PER_S


def test_the_only_date_may_be_that_of_a_clock_in_local_time() -> None:
    lines = [
        line
        for k in range(20)
        for line in (said("GP", "GGA", later(seconds=k)), said("II", "ZDA", later(hours=10, seconds=k)))
    ]
    found = sentence_times(lines)
    assert utc_of(found) == "2026-05-12T10:08:00.000"
    assert [clock.kind for clock in found.clocks] == ["local-time"]


@pytest.mark.parametrize(
    ("shift_s", "kind", "words"),
    [
        (
            18.0,
            "gps-time",
            "GNRMC gives GPS time, without leap seconds, 18 s ahead of GPRMC: its 20 sentences are not used",
        ),
        (-5400.0, "local-time", "GNRMC gives local time, 1 h 30 min behind GPRMC: its 20 sentences are not used"),
        (-3.0, "repeats", "GNRMC repeats times of GPRMC, up to 3 s old: its 20 sentences are not used"),
        (100.0, "offset", "GNRMC is 100 s ahead of GPRMC: its 20 sentences are not used"),
        (0.04, "transmission", "GNRMC gives the time of transmission, 0.04 s after the fix of GPRMC"),
    ],
)
def test_every_other_clock_has_a_name(shift_s: float, kind: str, words: str) -> None:
    beside = stream("GN", later(seconds=shift_s), kinds=["RMC"])
    (clock,) = sentence_times(interleaved(stream(kinds=["RMC"]), beside)).clocks
    assert (clock.kind, clock.words()) == (kind, words)


def test_the_lines_of_a_second_receiver_with_a_clock_of_its_own_are_kept_where_the_boats_file_names_it(
    tmp_path: Path,
) -> None:
    source = write(tmp_path, *interleaved(stream(kinds=["RMC"]), stream("GN", later(seconds=18), kinds=["RMC"])))
    config = tmp_path / "boat.toml"
    receiver = '[[sensor]]\nid = "gps{0}"\nport = "p"\nrole = "gps"\ntalkers = ["{1}"]\n'
    two = receiver.format(1, "GP") + receiver.format(2, "GN")
    config.write_text(f'[boat]\nid = "b"\n[[port]]\nname = "p"\npath = "/dev/p"\n{two}')
    summary = convert(source, tmp_path / "out", config_file=config)
    assert summary["accepted"]["gps2"] == {"RMC": 20}
    assert summary["seconds"] < 23
    assert convert(source, tmp_path / "out")["skipped"] == {"another clock": 20}


def test_what_is_longer_than_its_lines_fill_is_said(tmp_path: Path) -> None:
    summary = convert(write(tmp_path, *stream(), *LATER), tmp_path / "out")
    assert summary["notes"] == ["of 1820 s its lines fill 39 s: the longest gap is 1780 s before line 61"]


def test_a_clock_that_is_set_back_is_said(tmp_path: Path) -> None:
    summary = convert(write(tmp_path, *stream(), *stream(start=later(seconds=2))), tmp_path / "out")
    assert summary["notes"] == ["the clock is set back by 17 s before line 61: no time is taken to have passed"]
    assert summary["seconds"] < 43
