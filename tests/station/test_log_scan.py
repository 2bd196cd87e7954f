"""Whatever happens to a file: no exception, no wrong record, and what is lost is named."""

import random
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType

from shore.logbook.log_reader import read_log
from shore.logbook.mcap.records import HEAD, MAGIC
from tests.station.log_files import (
    EACH_NS,
    UTC_NS,
    check_against,
    chunks_of,
    log_bytes,
    other_writer,
    records_of,
    seen,
    write,
)

SMALL, LARGE = 40, 400


def test_a_sound_log_has_no_losses_and_no_flaws() -> None:
    whole = seen(log_bytes(SMALL), check_index=True)
    assert (whole.losses, whole.scan.flaws) == ([], [])
    frames = [message for message in whole.messages if message[0] == "/frames"]
    assert [message[1] for message in frames] == list(range(SMALL))
    assert whole.scan.chunks == whole.scan.checked == SMALL // 10 + 2
    (trip,) = whole.others
    assert trip.name == "wayfix.trip"


@pytest.mark.parametrize("is_closed", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_every_byte_changed_gives_no_wrong_record_and_no_silent_loss(*, is_closed: bool) -> None:
    content = log_bytes(SMALL)
    if not is_closed:
        content = content[: next(at for opcode, at, _ in records_of(content) if opcode == 15)]
    truth = seen(log_bytes(SMALL))
    rng = random.Random(1)
    counts = {"lost": 0, "told": 0}
    for place in range(len(MAGIC), len(content)):
        broken = bytearray(content)
        broken[place] ^= rng.choice((0xFF, 1 << rng.randrange(8), rng.randrange(1, 256)))
        harmed = seen(bytes(broken), check_index=True)
        lost = check_against(truth, harmed)
        assert not lost or harmed.losses
        counts["lost"] += bool(lost)
        counts["told"] += bool(lost or harmed.losses or harmed.scan.flaws)
        if is_closed and lost:  # the index says what was there
            assert all(loss.is_exact for loss in harmed.losses)
            assert (harmed.losses[0].start_ns, harmed.losses[0].end_ns) == (lost[0][2], lost[-1][2])
            assert harmed.losses[0].records == len(lost)
    assert counts["lost"] > len(content) // 3
    assert counts["told"] > 0.95 * len(content) - 500  # metadata and head have no checksum


@pytest.mark.slow
def test_two_thousand_bytes_changed_in_a_longer_log() -> None:
    content, truth = log_bytes(LARGE), seen(log_bytes(LARGE))
    rng = random.Random(9)
    for _ in range(2000):
        broken = bytearray(content)
        count = rng.choice((1, 1, 1, 3))
        for _ in range(count):
            broken[rng.randrange(len(MAGIC), len(content))] ^= rng.randrange(1, 256)
        harmed = seen(bytes(broken))
        lost = check_against(truth, harmed, is_counted=False)
        assert count > 1 or len(lost) <= 40, "one byte costs one chunk"
        assert not lost or harmed.losses


def test_damage_between_chunks_costs_nothing_and_is_said() -> None:
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    rng = random.Random(7)
    for opcode, at, end in records_of(content):
        if opcode in (7, 8, 11, 2):  # message index, chunk index, statistics, footer
            for place in (at + rng.randrange(1, HEAD.size), rng.randrange(at + HEAD.size, end)):
                broken = bytearray(content)
                broken[place] ^= 0x55
                harmed = seen(bytes(broken), check_index=True)
                assert harmed.messages == truth.messages
                assert not harmed.losses
                (flaw,) = harmed.scan.flaws
                assert flaw.first_byte <= place < flaw.end_byte or opcode != 7
                assert "no record lost" in str(flaw)


def test_a_chunk_whose_type_is_damaged_is_no_silent_loss() -> None:
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    at, _ = chunks_of(content)[2]
    for opcode in set(range(256)) - {6}:
        broken = bytearray(content)
        broken[at] = opcode
        harmed = seen(bytes(broken))
        assert harmed.messages == truth.messages, "its checksum vouches for it"
        assert [flaw.first_byte for flaw in harmed.scan.flaws] == [at]


def test_a_message_index_of_the_type_of_a_message_gives_no_message() -> None:
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    for opcode, at, _ in records_of(content):
        if opcode in (7, 12):
            broken = bytearray(content)
            broken[at] = 5
            assert seen(bytes(broken)).messages == truth.messages


def test_a_log_cut_anywhere_opens_and_keeps_what_was_synced_before_the_cut(tmp_path: Path) -> None:
    path, synced = write(tmp_path, range(300))
    whole, truth = path.read_bytes(), seen(path.read_bytes())
    data_end = next(at for opcode, at, _ in records_of(whole) if opcode == 15)
    rng = random.Random(2)
    for cut in [9, len(whole) - 1, data_end, *(rng.randrange(9, len(whole)) for _ in range(1000))]:
        harmed = seen(whole[:cut])
        lost = check_against(truth, harmed)
        assert harmed.messages == truth.messages[: len(harmed.messages)]
        certain = max(count for size, count in [(0, 0), *synced] if size <= cut)
        assert sum(message[0] == "/frames" for message in harmed.messages) >= certain
        loss = harmed.scan.cut
        if cut < data_end + 13:
            assert loss is not None
            assert loss.end_byte == cut
            assert loss.start_ns == (harmed.messages[-1][2] if harmed.messages else None)
            assert loss.end_ns is None
        else:
            assert not lost
            assert loss is None
            assert "no record lost" in str(harmed.scan.flaws[0])


def test_zeros_after_a_power_cut_are_the_end_of_the_log() -> None:
    content, truth = log_bytes(LARGE), seen(log_bytes(LARGE))
    rng = random.Random(3)
    for cut in (rng.randrange(200, len(content) - 20) for _ in range(100)):
        harmed = seen(content[:cut] + bytes(len(content) - cut))
        check_against(truth, harmed)
        assert harmed.messages == truth.messages[: len(harmed.messages)]
        if harmed.scan.cut is not None:
            assert harmed.scan.cut.end_byte == len(content)
    chunk = chunks_of(content)[5][0]
    harmed = seen(content[:chunk] + bytes(len(content) - chunk))
    assert harmed.scan.cut
    assert harmed.scan.cut.first_byte == chunk
    assert "zeros to the end" in harmed.scan.cut.reason


def test_a_lost_block_in_the_middle_costs_its_chunks_only() -> None:
    content, truth = log_bytes(LARGE), seen(log_bytes(LARGE))
    rng = random.Random(4)
    for is_closed in (True, False):
        body = content if is_closed else content[:-2000]
        for _ in range(100):
            at, size = rng.randrange(50, len(body) - 4096), rng.choice((1, 100, 4096))
            harmed = seen(body[:at] + rng.randbytes(size) + body[at + size :])
            lost = check_against(truth, harmed)
            touched = [chunk for chunk in chunks_of(content) if chunk[0] < at + size and at < chunk[1]]
            if is_closed:
                assert len(harmed.scan.losses) <= 1
                assert harmed.scan.chunks >= len(chunks_of(content)) - len(touched)
                assert not harmed.scan.losses or harmed.scan.losses[0].records == len(lost)


def test_a_stretch_cut_out_of_the_middle_is_missed() -> None:
    content, truth = log_bytes(LARGE), seen(log_bytes(LARGE))
    (first, _), (_, last) = chunks_of(content)[4], chunks_of(content)[6]
    index_end = next(at for opcode, at, _ in records_of(content) if at >= last and opcode == 6)
    harmed = seen(content[:first] + content[index_end:])
    lost = check_against(truth, harmed)
    assert sum(loss.records or 0 for loss in harmed.scan.losses) == len(lost) > 0


def test_channels_of_a_damaged_first_chunk_come_from_the_end_of_a_closed_log() -> None:
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    broken = bytearray(content)
    for at, end in chunks_of(content)[:2]:  # /session, then the first frames with their channels
        broken[(at + end) // 2] ^= 0xFF
    harmed = seen(bytes(broken))
    lost = check_against(truth, harmed)
    assert 0 < len(lost) < 40
    assert {message[0] for message in harmed.messages} == {message[0] for message in truth.messages}


def test_records_of_channels_that_nobody_names_are_counted_and_never_guessed() -> None:
    content = log_bytes(SMALL)
    data_end = next(at for opcode, at, _ in records_of(content) if opcode == 15)
    broken = bytearray(content[:data_end])
    at, end = chunks_of(content)[1]
    broken[(at + end) // 2] ^= 0xFF
    truth, harmed = seen(content), seen(bytes(broken))
    lost = check_against(truth, harmed)
    assert {message[0] for message in harmed.messages} == {"/session"}
    unknown = [loss for loss in harmed.scan.losses if "channel is gone" in loss.reason]
    assert [(loss.first_byte, loss.end_byte) for loss in unknown] == [
        (chunks_of(content)[2][0], chunks_of(content)[4][1])
    ]
    assert sum(loss.records or 0 for loss in harmed.scan.losses) == len(lost)


@pytest.mark.slow
def test_ten_thousand_kinds_of_harm() -> None:
    whole = [log_bytes(SMALL), log_bytes(100), other_writer(), other_writer(compression=CompressionType.LZ4)]
    truths = [seen(content) for content in whole]
    for seed in range(10_000):
        rng = random.Random(seed)
        kind = rng.randrange(len(whole))
        content = bytearray(whole[kind])
        if rng.random() < 0.5:
            del content[len(content) * 3 // 4 :]
        for _ in range(rng.choice((1, 1, 2, 4))):
            at, size = rng.randrange(len(content)), rng.choice((1, 4, 60, 500, 3000))
            harm = rng.randrange(4)
            if harm == 0:
                content[at] ^= rng.randrange(1, 256)
            elif harm == 1:
                del content[at : at + size]
            elif harm == 2:
                content[at:at] = rng.randbytes(size)
            else:
                content[at : at + size] = bytes(min(size, len(content) - at))
            content += b"\x01" * (len(content) <= len(MAGIC))
        check_against(truths[kind], seen(bytes(content)), is_counted=False)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=400), st.integers(0, 3000), st.integers(0, 400))
def test_no_bytes_make_it_raise(junk: bytes, at: int, cut_out: int) -> None:
    content = log_bytes(SMALL)
    check_against(seen(content), seen(MAGIC + junk))
    check_against(seen(content), seen(content[:at] + junk + content[at + cut_out :]), is_counted=False)


def test_a_length_that_reaches_beyond_all_memory_is_damage() -> None:
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    at, _ = chunks_of(content)[3]
    size_at = at + HEAD.size + 16
    for place, value in ((at + 1, 2**63), (size_at, 2**63), (size_at, 0), (at + HEAD.size + 36, 2**40)):
        harmed = seen(content[:place] + value.to_bytes(8, "little") + content[place + 8 :], check_index=True)
        check_against(truth, harmed)
        assert harmed.losses or harmed.scan.flaws


def test_a_reader_tells_the_losses_of_a_file(tmp_path: Path) -> None:
    path, _ = write(tmp_path, range(100))
    content = bytearray(path.read_bytes())
    at, end = chunks_of(bytes(content))[4]  # frames 30 to 39
    content[(at + end) // 2] ^= 0xFF
    path.write_bytes(content)
    reader = read_log(path)
    assert len(list(reader.frames())) == 90
    (loss,) = reader.losses
    assert (loss.first_byte, loss.is_exact) == (at, True)
    assert (loss.start_ns, loss.end_ns) == (UTC_NS + 31 * EACH_NS, UTC_NS + 40 * EACH_NS)
    assert loss.seconds == pytest.approx(0.9)
    assert str(reader.damage) == str(loss)
    assert "from 2026-11-18 11:06:43.100 UTC to 2026-11-18 11:06:44.000 UTC (0.9 s)" in str(loss)
    assert not reader.is_cut
