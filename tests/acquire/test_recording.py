"""A recording as its lines: what was on the wire, what others wrote around it, and the baud rate that carries it."""

from pathlib import Path

import pytest

from common.errors import WayfixError
from common.units import NS_PER_S
from onboard.recorded.recording import MAX_FILE_BYTES, pace, read_recording
from tests.acquire.sentences import GGA
from tests.acquire.test_convert import write
from tests.acquire.test_sentence_time import HDG, gga, rmc


def test_rows_tag_blocks_and_time_stamps_are_taken_off(tmp_path: Path) -> None:
    quoted = [b"time,sentence", *[b'2025/04/11 12:08:16.1,7,"' + gga(t) + b'"' for t in range(5)], b"1,2,"]
    blocks = [b"\\s:rx1,c:1700000000*5A\\" + gga(t) for t in range(5)]
    stamps = [b"2022-09-02 11:41:14,288 " + gga(t) for t in range(5)]
    for lines, skipped in ((quoted, {"no-sentence": 2}), (blocks, {}), (stamps, {})):
        source = write(tmp_path, *lines)
        assert read_recording(source).lines == tuple(gga(t) + b"\r\n" for t in range(5))
        assert read_recording(source).skipped == skipped
    # One such line in a stream is damage, and is played as it was.
    few = write(tmp_path, gga(1), b"12:00:00 " + gga(2), gga(3))
    assert read_recording(few).lines[1] == b"12:00:00 " + gga(2) + b"\r\n"


def test_the_baud_rate_is_the_lowest_that_carries_the_lines(tmp_path: Path) -> None:
    slow = write(tmp_path, *[line for t in range(20) for line in (gga(t), rmc(t))], name="slow")
    fast = write(tmp_path, *[line for t in range(20) for line in (gga(t), rmc(t), *[HDG] * 40)], name="fast")
    assert pace(read_recording(slow)).baud == 4800
    assert pace(read_recording(fast)).baud == 19_200
    late = pace(read_recording(fast), baud=4800)
    assert late.lag_ns > 10 * NS_PER_S


def test_a_recording_longer_than_memory_allows_is_refused(tmp_path: Path) -> None:
    huge = tmp_path / "huge"
    with huge.open("wb") as stream:
        stream.truncate(MAX_FILE_BYTES + 1)
    with pytest.raises(WayfixError, match="longer than 128 MiB"):
        read_recording(huge)


def test_a_byte_order_mark_is_no_line(tmp_path: Path) -> None:
    file = tmp_path / "in.log"
    file.write_bytes(b"\xef\xbb\xbf# head\n" + GGA + b"\n")
    read = read_recording(file)
    assert read.skipped == {"comment": 1}
    assert read.bare == [GGA]
