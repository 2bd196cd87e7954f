"""The spool as the server uses it: append, read, retention, restart, and a second daemon by mistake."""

import os
import stat
import threading
from pathlib import Path

import pytest

from common.boat_config import SpoolTable
from onboard.journal import Journal
from onboard.spool import Batch, Run, Spool
from onboard.spool import shared_state as spool_state
from onboard.spool.segment_format import SEGMENT_BYTES, name_of
from tests.link.spooling import MIB, QUICK, FaultyDisk, Told, filled, identity, payload, read_all, spool_at, until

BOOTS = [identity(number).boot_id for number in range(5)]


@pytest.fixture(autouse=True)
def _over_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fault is over with the next sync that works."""
    monkeypatch.setattr("onboard.spool.writer.STEADY_S", 0.0)


def segments(directory: Path) -> list[Path]:
    return sorted(directory.glob("*.seg"))


def test_an_empty_spool(tmp_path: Path) -> None:
    spool = spool_at(tmp_path / "spool")
    assert spool.newest() is None
    assert spool.synced_seq == -1
    assert spool.runs() == [Run(BOOTS[1], 1, 0, 0)]
    assert spool.read(BOOTS[1], 0, 9, 1000) == Batch([], [], None)  # not made yet, not gone
    assert spool.read("f" * 16, 2, 9, 1000) == Batch([], [(2, 9)], None)
    spool.close(1.0)


def test_frames_come_back_after_restarts(tmp_path: Path) -> None:
    directory = tmp_path / "state" / "spool"
    filled(directory, 300, 1)
    filled(directory, 200, 2)
    told = Told()
    spool = spool_at(directory, 3, told=told)
    assert told == []
    spool.append(0, b"new")
    assert spool.runs() == [Run(BOOTS[1], 1, 0, 300), Run(BOOTS[2], 2, 0, 200), Run(BOOTS[3], 3, 0, 1)]
    for number, count in ((1, 300), (2, 200)):
        frames, gone = read_all(spool, BOOTS[number], 5, count + 10, 3000)
        assert frames == {seq: payload(seq) for seq in range(5, count)}
        assert gone == set(range(count, count + 11))  # a start that is over makes no more
    assert spool.read(BOOTS[3], 0, 9, 1000) == Batch([(0, b"new")], [], None)
    spool.close(5.0)


@pytest.mark.parametrize(("count", "size"), [(3000, 1000), (12, 300_000), (7, MIB)])
def test_records_over_the_edges_of_what_is_read_at_once(tmp_path: Path, count: int, size: int) -> None:
    filled(tmp_path / "spool", count, 1, size)
    spool = spool_at(tmp_path / "spool", 2)
    expected = {seq: payload(seq, size) for seq in range(count)}
    assert read_all(spool, BOOTS[1], 0, count - 1, 10**8) == (expected, set())
    for seq in (0, count // 3, count // 2, count - 1, 1):
        assert spool.read(BOOTS[1], seq, seq, 1) == Batch([(seq, expected[seq])], [], None)
    spool.close(1.0)


def test_modes(tmp_path: Path) -> None:
    directory = tmp_path / "spool"
    directory.mkdir(mode=0o755)
    filled(directory, 3)
    assert stat.S_IMODE(directory.stat().st_mode) == 0o700
    assert {stat.S_IMODE(path.stat().st_mode) for path in directory.iterdir()} == {0o600}


@pytest.mark.parametrize("on_disk", [True, False])
def test_batches(tmp_path: Path, on_disk: bool) -> None:
    spool = spool_at(tmp_path / "spool" if on_disk else None)
    for seq in (0, 1, 2, 5, 6, 9):  # 3, 4, 7 and 8 could not be encoded
        spool.append(seq, payload(seq, 100))
    assert spool.read(BOOTS[1], 0, 9, 250) == Batch([(0, payload(0, 100)), (1, payload(1, 100))], [], 2)
    assert spool.read(BOOTS[1], 2, 9, 250) == Batch([(2, payload(2, 100)), (5, payload(5, 100))], [(3, 4)], 6)
    assert spool.read(BOOTS[1], 6, 20, 1) == Batch([(6, payload(6, 100))], [], 7)
    assert spool.read(BOOTS[1], 7, 20, 1) == Batch([(9, payload(9, 100))], [(7, 8)], None)
    assert spool.read(BOOTS[1], 7, 8, 1) == Batch([], [(7, 8)], None)
    assert spool.newest() == (9, payload(9, 100))
    spool.close(5.0)


def test_from_disk_and_memory_alike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A ring of 20 frames, the rest on disk, the newest not written: one range over all three."""
    monkeypatch.setattr(spool_state, "RING_BYTES", 4000)
    disk = FaultyDisk()
    spool = spool_at(tmp_path / "spool", disk=disk)
    for seq in range(500):
        spool.append(seq, payload(seq))
    until(lambda: spool.synced_seq == 499)
    disk.gate.clear()
    for seq in range(500, 600):
        spool.append(seq, payload(seq))
    frames, gone = read_all(spool, BOOTS[1], 0, 599, 3000)
    disk.gate.set()
    assert not gone
    assert frames == {seq: payload(seq) for seq in range(600)}
    spool.close(5.0)


def test_memory_only_keeps_the_newest_four_mib() -> None:
    spool = spool_at(None)
    for seq in range(6000):
        spool.append(seq, payload(seq, 1000))
    (run,) = spool.runs()
    frames, gone = read_all(spool, BOOTS[1], 0, 5999)
    assert run.next_seq == 6000
    assert run.first_seq == min(frames) == len(gone) == 6000 - 4 * MIB // 1000
    assert spool.status()["directory"] is None
    spool.close(1.0)


def test_segments_and_their_names(tmp_path: Path) -> None:
    directory = tmp_path / "spool"
    filled(directory, 9000, 7, 1000)
    files = segments(directory)
    names = [name_of(path.name) for path in files]
    assert [name and name.number for name in names] == [7, 7, 7]
    assert names[0] is not None
    assert names[0].first_seq == 0
    assert all(SEGMENT_BYTES - 2000 < path.stat().st_size <= SEGMENT_BYTES for path in files[:2])


def test_retention_by_size(tmp_path: Path) -> None:
    directory, told = tmp_path / "spool", Told()
    filled(directory, 9000, 1, 1000)
    spool = spool_at(directory, 2, told=told)
    most = 0
    for seq in range(22_000):
        spool.append(seq, payload(seq, 1000))
        if seq % 500 == 0:
            until(lambda seq=seq: spool.synced_seq == seq)  # type: ignore[misc]
            most = max(most, sum(path.stat().st_size for path in segments(directory)))
    until(lambda: spool.synced_seq == 21_999)
    assert 12 * MIB < most <= 16 * MIB
    assert [run.boot_id for run in spool.runs()] == [BOOTS[2]]
    first = spool.runs()[0].first_seq
    assert first > 0
    frames, gone = read_all(spool, BOOTS[2], 0, 21_999)
    assert gone == set(range(first))
    assert frames == {seq: payload(seq, 1000) for seq in range(first, 22_000)}
    assert read_all(spool, BOOTS[1], 0, 8999) == ({}, set(range(9000)))
    assert told.codes == ["spool-rolling"]
    assert spool.status()["removed"] >= 3
    spool.close(5.0)


def test_retention_by_free_space(tmp_path: Path) -> None:
    """Others fill the disk: our oldest frames go, never the segment being written, and no more than is needed."""

    class Small(FaultyDisk):
        free = 500 * MIB

        def free_bytes(self, directory: Path) -> int:
            return self.free

        def unlink(self, path: Path) -> None:
            self.free += path.stat().st_size
            super().unlink(path)

    directory, told, disk = tmp_path / "spool", Told(), Small()
    filled(directory, 12_000, 1, 1000)
    spool = spool_at(directory, 2, disk=disk, told=told, table=SpoolTable(max_mib=64, min_free_mib=100, sync_s=0.0))
    spool.append(0, b"a")
    until(lambda: spool.synced_seq == 0)
    assert len(segments(directory)) == 4
    disk.free = 95 * MIB
    spool.append(1, b"b")
    until(lambda: len(segments(directory)) == 2)
    disk.free = 1 * MIB
    spool.append(2, b"c")
    until(lambda: len(segments(directory)) == 1)
    disk.free = 1 * MIB
    spool.append(3, b"d")
    until(lambda: spool.synced_seq == 3)
    assert len(segments(directory)) == 1
    assert read_all(spool, BOOTS[2], 0, 3)[0] == {0: b"a", 1: b"b", 2: b"c", 3: b"d"}
    assert told.codes == ["spool-low"]
    spool.close(5.0)


def test_a_reader_in_the_middle_of_what_is_unlinked(tmp_path: Path) -> None:
    directory = tmp_path / "spool"
    filled(directory, 9000, 1, 1000)
    spool = spool_at(directory, 2)
    batch = spool.read(BOOTS[1], 0, 8999, 50_000)
    assert batch.next_seq is not None
    for path in segments(directory)[:2]:
        path.unlink()  # the reader still has them in its list
    frames, gone = read_all(spool, BOOTS[1], batch.next_seq, 8999)
    assert frames.keys() | gone == set(range(batch.next_seq, 9000))
    assert max(gone) < min(frames)
    spool.close(1.0)


def test_readers_while_the_writer_writes_and_retires(tmp_path: Path) -> None:
    directory = tmp_path / "spool"
    filled(directory, 9000, 1, 1000)
    spool = spool_at(directory, 2)
    faults: list[str] = []
    done = threading.Event()

    def read_on() -> None:
        try:
            while not done.is_set():
                for boot, count in ((BOOTS[1], 9000), (BOOTS[2], 10**6)):
                    frames, _ = read_all(spool, boot, 0, count)
                    faults.extend(f"{seq}" for seq, data in frames.items() if data != payload(seq, 1000))
        except AssertionError as error:
            faults.append(repr(error))

    readers = [threading.Thread(target=read_on) for _ in range(2)]
    for reader in readers:
        reader.start()
    for seq in range(16_000):
        spool.append(seq, payload(seq, 1000))
        if seq % 1000 == 0:
            until(lambda seq=seq: spool.synced_seq >= seq - 1000)  # type: ignore[misc]
            frames, gone = read_all(spool, BOOTS[2], max(0, seq - 500), seq)
            assert not gone  # the newest are never gone for a moment
            assert len(frames) == min(501, seq + 1)
    done.set()
    for reader in readers:
        reader.join()
    assert not faults
    spool.close(5.0)


@pytest.mark.parametrize("number", [0, 1, 3])
def test_a_lost_start_counter(tmp_path: Path, number: int) -> None:
    """The order of starts is kept, whatever the counter says, and no clock on the wall is asked."""
    directory = tmp_path / "spool"
    for start in (1, 2, 3):
        filled(directory, 3, start)
    for path in segments(directory):
        os.utime(path, (0, 10**9 - len(path.name)))
    late = Spool(directory, identity(number), QUICK, Journal(Told(), lambda: 0))
    new = [f"{index:016x}" for index in (90, 91)]
    for boot_id in new:
        late.close(1.0)
        fresh = identity(number)
        late = Spool(
            directory,
            type(fresh)(fresh.boat_id, boot_id, fresh.clock_id, number),
            QUICK,
            Journal(Told(), lambda: 0),
        )
        late.append(0, b"x")
        until(lambda: late.synced_seq == 0)  # noqa: B023
    assert [run.boot_id for run in late.runs()] == [*BOOTS[1:4], *new]
    assert [run.start_no for run in late.runs()] == [1, 2, 3, number, number]
    assert [path.name[:10] for path in segments(directory)] == [f"{index:010d}" for index in range(1, 6)]
    late.close(1.0)


def test_a_second_daemon(tmp_path: Path) -> None:
    directory, told = tmp_path / "spool", Told()
    first = spool_at(directory, 1)
    second = spool_at(directory, 2, told=told)
    assert told.codes == ["spool-locked"]
    for seq in range(10):
        first.append(seq, payload(seq))
        second.append(seq, payload(seq))
    until(lambda: first.synced_seq == 9)
    assert second.synced_seq == -1
    assert len(segments(directory)) == 1
    assert read_all(second, BOOTS[2], 0, 9)[0] == {seq: payload(seq) for seq in range(10)}
    first.close(5.0)
    until(lambda: second.synced_seq == 9)  # tried again by itself
    second.poll()
    assert told.codes == ["spool-locked", "spool-restored"]
    assert [run.boot_id for run in second.runs()] == BOOTS[1:3]
    second.close(5.0)


def test_foreign_things_in_the_directory(tmp_path: Path) -> None:
    directory = tmp_path / "spool"
    filled(directory, 5)
    (directory / "notes.txt").write_text("mine")
    (directory / f"{9:010d}-{'e' * 16}-{0:012d}.seg").mkdir()
    (directory / f"{8:010d}-{'d' * 16}-{4:012d}.seg").write_bytes(b"")
    (directory / f"{7:010d}-{'c' * 16}-{4:012d}.seg").write_bytes(os.urandom(5000))
    spool = spool_at(directory, 2)
    spool.append(0, b"x")
    assert [run.boot_id for run in spool.runs()] == BOOTS[1:3]
    assert read_all(spool, "c" * 16, 0, 9) == ({}, set(range(10)))
    spool.close(5.0)
    assert (directory / "notes.txt").exists()


def test_a_damaged_tail_is_told_and_left_alone(tmp_path: Path) -> None:
    directory, told = tmp_path / "spool", Told()
    filled(directory, 100)
    (file,) = segments(directory)
    harmed = file.read_bytes()[:-150] + bytes(70)
    file.write_bytes(harmed)
    spool = spool_at(directory, 2, told=told)
    spool.append(0, b"x")
    until(lambda: spool.synced_seq == 0)
    assert told.codes == ["spool-damaged"]
    assert told[0].evidence["file"] == file.name
    assert file.read_bytes() == harmed
    assert len(segments(directory)) == 2
    frames, gone = read_all(spool, BOOTS[1], 0, 99)
    assert frames == {seq: payload(seq) for seq in range(99)}
    assert gone == {99}
    spool.close(1.0)
