"""Logs with bytes gone or put in, and of other writers: the same promises as in `test_log_scan`."""

import io
import random

import pytest
from mcap.writer import CompressionType, IndexType

from shore.logbook.mcap.damage import AnotherLog, Flaw
from shore.logbook.mcap.records import HEAD, MAGIC
from shore.logbook.mcap.scan import is_log
from tests.station.log_files import (
    EACH_NS,
    UTC_NS,
    check_against,
    chunks_of,
    log_bytes,
    other_writer,
    records_of,
    seen,
)

SMALL, LARGE = 40, 400


def test_of_two_logs_in_one_file_the_first_is_read_and_the_other_said() -> None:
    first, second = log_bytes(SMALL), other_writer()
    truth = seen(first)
    for behind in (second, first):
        both = seen(first + behind)
        assert (both.messages, both.losses) == (truth.messages, [])
        (flaw,) = both.scan.flaws
        assert isinstance(flaw, AnotherLog)
        assert (flaw.first_byte, flaw.end_byte) == (len(first), len(first) + len(behind))
        assert seen((first + behind)[flaw.first_byte :]).scan.flaws == [], "what the cure takes out is whole"
    rng = random.Random(5)
    for cut in (rng.randrange(9, len(first)) for _ in range(200)):
        both = seen(first[:cut] + second)
        if cut < chunks_of(first)[0][1]:
            assert both.messages == seen(second).messages, "a beginning of which nothing is sound is passed over"
            continue
        assert both.messages == truth.messages[: len(both.messages)], "nothing of the second log in the first"
        assert len(both.messages) == len(truth.messages) or both.losses
        assert any(isinstance(flaw, AnotherLog) and flaw.first_byte == cut for flaw in both.scan.flaws)


def test_a_damaged_magic_costs_nothing() -> None:
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    for whole in (content, content[: chunks_of(content)[-1][0]]):
        for broken in (b"\xff" * 8 + whole[8:], b"\x88" + whole[1:]):
            harmed = seen(broken)
            assert harmed.messages == truth.messages[: len(harmed.messages)]
            assert harmed.scan.losses == []
            assert harmed.scan.flaws[0] == Flaw(0, 8, "the first bytes are damaged")
            assert is_log(io.BytesIO(broken))
    for gone in (3, 8, 29, chunks_of(content)[0][0]):
        harmed = seen(content[gone:])
        assert harmed.messages == truth.messages
        assert harmed.losses == []
        assert harmed.scan.flaws
        assert is_log(io.BytesIO(content[gone:]))
    assert not is_log(io.BytesIO(b"$GPRMC," * 100))


def test_a_log_behind_other_bytes_is_read() -> None:
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    harmed = seen(b"tar" * 100 + content)
    assert (harmed.messages, harmed.losses) == (truth.messages, [])
    assert harmed.scan.flaws == [Flaw(0, 300, "bytes before the log")]


def test_bytes_cut_out_cost_the_chunks_they_stood_in_only() -> None:
    content, truth = log_bytes(LARGE), seen(log_bytes(LARGE))
    chunks = chunks_of(content)
    rng = random.Random(10)
    for _ in range(150):
        at, size = rng.randrange(len(content) * 2 // 3), int(10 ** rng.uniform(0, 4))
        harmed = seen(content[:at] + content[at + size :])
        lost = check_against(truth, harmed)
        touched = [chunk for chunk in chunks if chunk[0] < at + size and at < chunk[1]]
        assert harmed.scan.chunks == len(chunks) - len(touched)
        assert bool(lost) == bool(harmed.losses) == bool(touched)
        assert sum(loss.records or 0 for loss in harmed.losses) == len(lost)
        assert harmed.scan.flaws, "bytes that are gone are said"


def test_the_end_of_another_log_names_no_channel() -> None:
    first, second = log_bytes(SMALL), other_writer()
    chunks = chunks_of(first)
    start, end = chunks[2][0], chunks[4][1]  # chunks that name no channel, and nothing that begins or ends their log
    harmed = seen(MAGIC + first[start:end] + second[chunks_of(second)[0][0] :])
    assert harmed.messages == seen(second).messages
    (loss,) = harmed.losses
    assert loss.records == 3 * 31
    harmed = seen(MAGIC + first[start:end] + first[chunks[-1][0] :])
    assert len(harmed.messages) == 3 * 31 + 1, "its own end does"


@pytest.mark.parametrize("block", [*range(20, 30), 100, 4 * 2**20])
def test_the_end_of_a_log_is_found_wherever_it_stands(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shore.logbook.mcap.index_at_end.BLOCK", block)
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    at = chunks_of(content)[1][0] + 20
    for gone in range(1, 40, 6):
        harmed = seen(content[:at] + content[at + gone :])
        assert len(check_against(truth, harmed)) == 31
        assert [loss.records for loss in harmed.losses] == [31]


def test_metadata_of_which_bytes_are_gone_is_not_believed() -> None:
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    _, end = next((at, end) for opcode, at, end in records_of(content) if opcode == 12)
    data_end = next(at for opcode, at, _ in records_of(content) if opcode == 15)
    for gone in (2, 3, 20):  # of its last word, which then seems to reach into the next record
        harmed = seen(content[: end - gone] + content[end:])
        assert (harmed.messages, harmed.losses, harmed.others) == (truth.messages, [], [])
        assert harmed.scan.flaws
        harmed = seen(content[: end - gone] + content[data_end:])
        assert (harmed.messages, harmed.scan.cut, harmed.others) == (truth.messages[:-1], None, [])


def test_damage_behind_the_last_chunk_of_a_log_with_bytes_gone_is_no_cut() -> None:
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    at, end = chunks_of(content)[-1]
    for harmed in (seen(content[: at + 50] + content[at + 60 :]), seen(content[: end + 40] + content[end + 50 :])):
        lost = check_against(truth, harmed)
        assert harmed.scan.cut is None
        assert sum(loss.records or 0 for loss in harmed.losses) == len(lost) <= 1


def test_bytes_put_in_cost_a_chunk_or_two_and_no_record_comes_twice() -> None:
    content, truth = log_bytes(LARGE), seen(log_bytes(LARGE))
    rng = random.Random(11)
    chunks = chunks_of(content)
    for _ in range(150):
        at, size = rng.randrange(len(content) * 2 // 3), int(10 ** rng.uniform(0, 4))
        origin = rng.randrange(at + 1)
        junk = rng.choice((rng.randbytes(size), content[origin:at][:size], bytes(size)))
        harmed = seen(content[:at] + junk + content[at:])
        lost = check_against(truth, harmed)
        touched = [chunk for chunk in chunks if chunk[0] < at < chunk[1]]
        assert harmed.scan.chunks >= len(chunks) - len(touched) - 1, "half a chunk put in may reach into the next"
        assert sum(loss.records or 0 for loss in harmed.losses) == len(lost)
        assert harmed.scan.flaws


def test_bytes_behind_the_end_are_said() -> None:
    content = log_bytes(SMALL)
    harmed = seen(content + b"rubbish" * 100)
    assert harmed.messages == seen(content).messages
    assert not harmed.losses
    (flaw,) = harmed.scan.flaws
    assert (flaw.first_byte, flaw.end_byte) == (len(content), len(content) + 700)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.NONE},
        {"enable_crcs": False},
        {"use_chunking": False},
        {"use_chunking": False, "enable_data_crcs": True},
        {"index_types": IndexType.NONE},
        {"use_statistics": False, "use_summary_offsets": False},
        {"repeat_channels": False, "repeat_schemas": False, "use_statistics": False, "index_types": IndexType.NONE},
    ],
    ids=str,
)
def test_logs_of_other_writers_are_read(options: dict[str, object]) -> None:
    content = other_writer(**options)  # type: ignore[arg-type]
    whole = seen(content, check_index=True)
    assert [message[4] for message in whole.messages] == [b'{"n":%d}' % number for number in range(60)]
    assert [type(item).__name__ for item in whole.others] == ["Metadata", "Attachment"]
    assert (whole.losses, whole.scan.flaws) == ([], [])
    rng = random.Random(6)
    for _ in range(200):  # cut: a prefix, whoever wrote it
        harmed = seen(content[: rng.randrange(9, len(content))])
        assert harmed.messages == whole.messages[: len(harmed.messages)]
        assert len(harmed.messages) == 60 or harmed.losses


def test_private_records_are_skipped() -> None:
    content = other_writer()
    private = HEAD.pack(0x81, 5) + b"hello"
    for place in sorted((end for opcode, _, end in records_of(content) if opcode in (6, 7, 12)), reverse=True)[:8]:
        data_end = next(at for opcode, at, _ in records_of(content) if opcode == 15)
        harmed = seen(content[:place] + private + content[place:data_end])
        assert harmed.messages == seen(content).messages
        assert not harmed.scan.losses


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.NONE])
def test_damage_in_logs_of_other_writers_gives_no_wrong_record(compression: CompressionType) -> None:
    content = other_writer(compression=compression)
    truth = seen(content)
    rng = random.Random(8)
    for _ in range(1000):
        broken = bytearray(content)
        broken[rng.randrange(len(MAGIC), len(content))] ^= rng.randrange(1, 256)
        check_against(truth, seen(bytes(broken)))


def test_a_chunk_cut_out_is_missed_beside_another_loss() -> None:
    at, end = chunks_of(log_bytes(SMALL))[3]
    content = bytearray(log_bytes(SMALL))
    content[(at + end) // 2] ^= 0xFF
    harmed = seen(bytes(content[:29] + content[29 + 384 :]))
    assert len(check_against(seen(log_bytes(SMALL)), harmed)) == 32
    assert [loss.records for loss in harmed.losses] == [1, 31]


def test_messages_outside_of_chunks_are_not_believed_behind_damage() -> None:
    content = other_writer(use_chunking=False)
    truth = seen(content)
    messages = [(at, end) for opcode, at, end in records_of(content) if opcode == 5]
    at, _ = messages[20]
    broken = content[: at + 1] + (2**40).to_bytes(8, "little") + content[at + 9 :]
    harmed = seen(broken)
    assert harmed.messages == truth.messages[:20]
    (loss,) = harmed.losses
    assert (loss.first_byte, loss.records) == (at, 40)
    inside = HEAD.pack(5, 22 + 3) + bytes(22) + b"abc"  # what looks like a message within damage
    harmed = seen(content[:at] + b"\x10" * 20 + inside + content[at:])
    assert harmed.messages == truth.messages[:20]


def test_a_message_of_an_unknown_channel_costs_itself_only() -> None:
    content = other_writer(use_chunking=False)
    truth = seen(content)
    at, _ = [(at, end) for opcode, at, end in records_of(content) if opcode == 5][20]
    harmed = seen(content[: at + 9] + b"\x77" + content[at + 10 :])
    assert harmed.messages == truth.messages[:20] + truth.messages[21:]
    (loss,) = harmed.losses
    assert (loss.first_byte, loss.records, loss.is_exact) == (at, 1, True)
    assert loss.start_ns == loss.end_ns == truth.messages[20][2]


def test_a_chunk_with_a_part_of_its_index_is_one_loss() -> None:
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    at, end = chunks_of(content)[2]
    broken = bytearray(content)
    broken[(at + end) // 2] ^= 0xFF
    _, second, *_ = [at for opcode, at, _ in records_of(content) if opcode == 7 and at > end - 1]
    broken[second] ^= 0x50
    harmed = seen(bytes(broken))
    lost = check_against(truth, harmed)
    (loss,) = harmed.losses
    assert (loss.records, loss.is_exact) == (len(lost), True)
    assert (loss.start_ns, loss.end_ns) == (lost[0][2], lost[-1][2])


def test_damage_in_a_message_index_of_a_log_that_was_not_closed_costs_nothing() -> None:
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    indexes = [at for opcode, at, _ in records_of(content) if opcode == 7]
    content = content[: chunks_of(content)[-1][0]]
    for at in (at for at in indexes if at < len(content) - 600):
        broken = bytearray(content)
        broken[at + 3] ^= 0x40
        harmed = seen(bytes(broken))
        assert harmed.messages == truth.messages[: len(harmed.messages)]
        assert not harmed.scan.losses
        assert harmed.scan.cut
        assert harmed.scan.cut.first_byte == len(content)
        (flaw,) = harmed.scan.flaws
        assert flaw.what == "damage in a message index"


def test_channels_that_a_later_chunk_names_are_known() -> None:
    """Some writers repeat channels in each chunk."""
    first, second = other_writer(), other_writer(repeats=True)
    _, end = chunks_of(first)[0]
    data_end = next(at for opcode, at, _ in records_of(first) if opcode == 15)
    again = b"".join(second[at:end] for at, end in chunks_of(second))
    broken = bytearray(first[:data_end] + again)
    broken[end - 3] ^= 0xFF
    harmed = seen(bytes(broken))
    numbers = [message[1] for message in harmed.messages]
    lost = next(number for number in range(60) if numbers[0] == number)
    assert lost > 0
    assert numbers == [*range(lost, 60), *range(60)]
    assert {message[0] for message in harmed.messages} == {"/a", "/b"}


def test_spans_in_the_head_of_a_chunk_count_only_where_all_else_agrees() -> None:
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    content = content[: chunks_of(content)[-1][0]]  # no index at the end
    at, end = chunks_of(content)[2]
    for wrong in (bytes(8), b"\xff" * 8):
        for place in (at + HEAD.size, at + HEAD.size + 8):  # start, end
            for keeps_index in (True, False):
                broken = bytearray(content)
                broken[(at + end) // 2] ^= 0xFF
                broken[place : place + 8] = wrong
                rest = bytes(broken)
                if not keeps_index:
                    rest = rest[:end] + rest[chunks_of(content)[3][0] :]
                harmed = seen(rest)
                check_against(truth, harmed)
                assert not harmed.scan.losses[0].is_exact
                assert harmed.scan.losses[0].start_ns == UTC_NS + 10 * EACH_NS
                assert harmed.scan.losses[0].end_ns == UTC_NS + 21 * EACH_NS


@pytest.mark.parametrize("block", [100, 500, 4 * 2**20])
def test_the_next_chunk_is_found_wherever_it_begins(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shore.logbook.mcap.source.BLOCK", block)
    content, truth = log_bytes(SMALL), seen(log_bytes(SMALL))
    content = content[: chunks_of(content)[-1][0]]
    at, end = chunks_of(content)[2]
    nearly = b"\x06" + bytes(36)  # what looks like the head of a chunk up to its last bytes, and overlaps the real one
    for junk in (b"", nearly, b"\x06" + bytes(33), *(bytes([1]) * count for count in range(0, 130, 7))):
        harmed = seen(
            content[: at + 1] + b"\xff" * 8 + content[at + 9 : end - 300] + junk + content[chunks_of(content)[3][0] :]
        )
        lost = check_against(truth, harmed, is_counted=False)
        assert len(lost) == 31 + len([message for message in truth.messages if message[2] > UTC_NS + 40 * EACH_NS]) + 1
        assert len(harmed.scan.losses) == 1
