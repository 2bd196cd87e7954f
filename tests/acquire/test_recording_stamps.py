"""Time stamps beside the sentences of a log: tag blocks, prefixes and suffixes say when a line came."""

from pathlib import Path

import pytest

from common.units import NS_PER_S
from onboard.recorded.convert import convert
from onboard.recorded.line_times import Schedule, recorded_times
from onboard.recorded.recording import _unwrapped, pace, read_recording
from tests.acquire.sentences import sealed
from tests.acquire.test_convert import write
from tests.acquire.test_recording_clocks import START, later, said, utc_of
from tests.acquire.test_sentence_time import HDG
from tests.cases import CASES, needs_cases


@needs_cases
@pytest.mark.parametrize("name", ["tag-block-times", "time-before-compass", "time-behind-sentence"])
def test_time_stamps_beside_the_sentences_are_their_times(name: str, tmp_path: Path) -> None:
    paced = pace(read_recording(CASES / "board" / f"{name}.nmea"))
    assert paced.schedule.at_ns == [k * 10 * NS_PER_S for k in range(6)]
    assert utc_of(paced.schedule) == "2026-11-30T12:00:00.000"
    summary = convert(CASES / "board" / f"{name}.nmea", tmp_path / "out")
    assert (summary["pace"], summary["rejected"], summary["notes"]) == ("stamps", {}, [])
    assert sum(summary["accepted"][summary["sensors"][0]].values()) == 6


def block(text: str) -> bytes:
    r"""A tag block: `\\c:1796040000*60\\`."""
    return b"\\" + sealed(text)[1:] + b"\\"


def stamped(*lines: bytes) -> Schedule:
    """The schedule of a log in which something stands beside each sentence."""
    found = [_unwrapped(line) for line in lines]
    assert None not in found
    return recorded_times([data.rstrip() for data, _ in found], [stamp for _, stamp in found])  # type: ignore[misc]


@pytest.mark.parametrize(
    ("form", "first"),
    [
        ("{ms} {line}", "2026-05-12T10:08:00.000"),
        ("[{ms}000] {line}", "2026-05-12T10:08:00.000"),
        ("{s}.000: {line}", "2026-05-12T10:08:00.000"),
        ("7,{iso}Z,{line}", "2026-05-12T10:08:00.000"),
        ("[{iso}.000] {line}", "2026-05-12T10:08:00.000"),
        ("{day:%b %d %H:%M:%S} {line}", None),
        ("{iso}Z {line}", "2026-05-12T10:08:00.000"),
        ("{iso}+02:00;{line}", "2026-05-12T08:08:00.000"),
        ('{ms},NMEA0183,HDG,"{line}"', "2026-05-12T10:08:00.000"),
        ("{line},{s}", "2026-05-12T10:08:00.000"),
        ("{line} {iso}", "2026-05-12T10:08:00.000"),
    ],
)
def test_time_stamps_of_any_form(form: str, first: str | None) -> None:
    lines = []
    for k in range(10):
        utc = later(seconds=k)
        s = round(utc.timestamp())
        lines.append(form.format(s=s, ms=s * 1000, iso=utc.isoformat()[:19], line=HDG.decode(), day=utc).encode())
    found = stamped(*lines)
    assert found.at_ns == [k * NS_PER_S for k in range(10)]
    assert (found.stamped, utc_of(found)) == (True, first)


@pytest.mark.parametrize(
    ("text", "first"),
    [
        ("s:mux1,c:177858048{k}", "2026-05-12T10:08:00.000"),
        ("g:1-2-3,c:177858048{k}000,s:r", "2026-05-12T10:08:00.000"),
        ("c:123{k}", None),
    ],
)
def test_tag_blocks_say_when_their_line_came_but_for_damaged_ones(text: str, first: str | None) -> None:
    lines = [block(text.format(k=k)) + HDG for k in range(10)]
    assert stamped(*lines).at_ns == [k * NS_PER_S for k in range(10)]
    assert utc_of(stamped(*lines)) == first
    lines[5] = lines[5].replace(b"c:1", b"c:2")
    assert [t_ns // NS_PER_S for t_ns in stamped(*lines).at_ns] == [0, 1, 2, 3, 4, 4, 6, 7, 8, 9]


def test_a_single_damaged_stamp_is_no_gap() -> None:
    lines = [f"{1_778_580_480 + k + 800_000 * (k == 15)} ".encode() + HDG for k in range(30)]
    assert stamped(*lines).at_ns[-1] == 29 * NS_PER_S


def test_of_a_message_in_two_lines_the_first_alone_may_have_a_stamp() -> None:
    two = [line for k in range(5) for line in (block(f"g:1-2-{k},c:177858048{k}") + HDG, block(f"g:2-2-{k}") + HDG)]
    assert stamped(*two).at_ns[::2] == [k * NS_PER_S for k in range(5)]


def test_stamps_that_are_times_of_day_run_over_midnight() -> None:
    times = [
        f"{hour:02}:{minute:02}:{second:02}.250" for hour, minute, second in ((23, 59, 58), (23, 59, 59), (0, 0, 1))
    ]
    found = stamped(*(f"{time} {HDG.decode()}".encode() for time in times))
    assert found.at_ns == [0, NS_PER_S, 3 * NS_PER_S]
    assert (found.first_tod_ms, found.first_utc_ms) == (86_398_250, None)


def test_stamps_say_when_and_sentences_say_which_utc() -> None:
    def arrival(k: int) -> bytes:  # of a computer in local time
        at = later(hours=2, seconds=k, milliseconds=300 + 10 * (k % 3))
        return at.isoformat(sep=" ", timespec="milliseconds")[:23].encode()

    found = stamped(*(arrival(k) + b" " + said("GP", "RMC", later(seconds=k)) for k in range(20)))
    assert found.at_ns[:4] == [0, 1_010_000_000, 2_020_000_000, 3 * NS_PER_S]
    assert found.first_utc_ms == pytest.approx(START.timestamp() * 1000, abs=11)
    assert found.stamp_ahead_s == pytest.approx(7200.3, abs=0.02)


def test_stamped_lines_in_disorder_are_put_in_order() -> None:
    found = stamped(*(f"{1_778_580_480 + second} ".encode() + HDG for second in (0, 4, 1, 5, 30, 20)))
    assert found.order == (0, 2, 1, 3, 5, 4)
    assert found.at_ns == [second * NS_PER_S for second in (0, 1, 4, 5, 20, 30)]


def test_a_computer_whose_clock_was_set_has_no_gap_of_years() -> None:
    times = (1_000_000_000, 1_000_000_001, 1_778_580_480, 1_778_580_481)
    assert stamped(*(f"{second} ".encode() + HDG for second in times)).at_ns[-1] <= 3 * NS_PER_S


def test_lines_of_one_second_are_spread_over_it_and_bursts_stay_together() -> None:
    lines = [HDG, said("GP", "RMC", START), said("GP", "GGA", START), HDG]
    found = stamped(*(f"{1_778_580_480 + k} ".encode() + line for k in range(3) for line in lines))
    assert [t_ns / NS_PER_S for t_ns in found.at_ns[:5]] == [0.0, 0.25, 0.25, 0.75, 1.0]


def test_a_bare_sentence_among_stamped_ones_is_kept(tmp_path: Path) -> None:
    lines = [f"{1_778_580_480 + k} ".encode() * (k % 3 > 0) + HDG for k in range(9)]
    read = read_recording(write(tmp_path, *lines))
    assert (len(read.lines), read.skipped) == (9, {})


@pytest.mark.parametrize(
    ("period_s", "letters", "late_s", "is_used"),
    [(1.0, 19, 0.0, True), (0.2, 19, 0.0, True), (0.2, 23, 0.0, True), (0.2, 23, 0.6, False)],
)
def test_stamps_that_wander_against_the_sentences_are_not_used(
    period_s: float, letters: int, late_s: float, is_used: bool
) -> None:
    lines = []
    for k in range(50):
        at = later(seconds=k * period_s + 7.3 + late_s * (k % 7 == 0))
        stamp = at.isoformat(timespec="milliseconds")[:letters]
        lines.append(f"{stamp} ".encode() + said("GP", "RMC", later(seconds=k * period_s)))
    found = stamped(*lines)
    assert (found.stamped, found.stamps_wander) == (is_used, not is_used)
    assert found.at_ns == pytest.approx([k * period_s * NS_PER_S for k in range(50)], abs=0.21 * NS_PER_S)
    assert found.first_utc_ms == pytest.approx(START.timestamp() * 1000, abs=210)
