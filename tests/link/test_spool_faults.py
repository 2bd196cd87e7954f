"""Disks that are slow, full, broken or read-only: frames go on, and what happened is told once."""

import errno
import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from common.atomic_file import sync_directory
from common.boat_config import SpoolTable
from onboard.spool import shared_state as spool_state
from onboard.spool.segment_index import segments_in
from onboard.spool.verify import Examination
from tests.link.spooling import MIB, QUICK, FaultyDisk, Told, filled, identity, payload, read_all, spool_at, until

BOOT = identity().boot_id


@pytest.fixture(autouse=True)
def _over_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fault is over with the next sync that works."""
    monkeypatch.setattr("onboard.spool.writer.STEADY_S", 0.0)


def test_every_sync_takes_half_a_second(tmp_path: Path) -> None:
    disk = FaultyDisk()
    spool = spool_at(tmp_path / "spool", disk=disk)
    spool.append(0, payload(0))
    disk.sync_s = 0.5
    longest = 0.0
    for seq in range(1, 200):
        begin = time.thread_time()  # of this thread: other work on the machine does not count, waiting is seen below
        wall = time.monotonic()
        spool.append(seq, payload(seq, 1200))
        longest = max(longest, min(time.monotonic() - wall, 0.4 + time.thread_time() - begin))
        time.sleep(0.005)
    assert disk.syncs >= 2
    assert longest < 0.25
    assert read_all(spool, BOOT, 0, 199)[0].keys() == set(range(200))
    disk.sync_s = 0.0
    spool.close(5.0)
    assert spool.synced_seq == 199


def test_the_queue_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spool_state, "QUEUE_BYTES", 20_000)
    disk, told = FaultyDisk(), Told()
    spool = spool_at(tmp_path / "spool", disk=disk, told=told)
    spool.append(0, payload(0))
    until(lambda: spool.synced_seq == 0)
    disk.gate.clear()
    for seq in range(1, 201):
        spool.append(seq, payload(seq))
    assert told.codes == ["spool-behind"]
    assert spool.status()["dropped"] == 100
    assert read_all(spool, BOOT, 0, 200)[0] == {seq: payload(seq) for seq in range(201)}  # still in memory
    disk.gate.set()
    until(lambda: spool.synced_seq == 100)
    for seq in range(201, 211):
        spool.append(seq, payload(seq))
        until(lambda seq=seq: spool.synced_seq == seq)  # type: ignore[misc]
    assert told.codes == ["spool-behind", "spool-caught-up"]
    assert told[1].evidence["dropped"] == 100
    spool.close(5.0)
    later = spool_at(tmp_path / "spool", 2)
    frames, gone = read_all(later, BOOT, 0, 210)
    assert gone == set(range(101, 201))
    assert frames == {seq: payload(seq) for seq in range(211) if seq not in gone}
    later.close(1.0)


@pytest.mark.parametrize("faults", [1, 3])
def test_a_failed_sync_begins_a_new_segment(tmp_path: Path, faults: int) -> None:
    """What was not durable is written again; the file whose sync failed is never touched again."""
    directory, disk, told = tmp_path / "spool", FaultyDisk(), Told()
    spool = spool_at(directory, disk=disk, told=told)
    for seq in range(50):
        spool.append(seq, payload(seq))
    until(lambda: spool.synced_seq == 49)
    (file,) = directory.glob("*.seg")
    disk.sync_faults = faults
    before = disk.syncs
    spool.append(50, payload(50))
    until(lambda: disk.syncs > before)
    left = file.read_bytes()
    for seq in range(51, 100):
        spool.append(seq, payload(seq))
    until(lambda: spool.synced_seq == 99)
    spool.close(5.0)
    assert file.read_bytes() == left
    assert told.codes == ["spool-failed", "spool-restored"]
    later = spool_at(directory, 2)
    assert read_all(later, BOOT, 0, 99, 700) == ({seq: payload(seq) for seq in range(100)}, set())
    later.close(1.0)
    # A power cut may leave of that file only what was synced: nothing is missed, by verify either.
    file.write_bytes(left[: left.index(payload(49)) + len(payload(49))])
    later = spool_at(directory, 3)
    assert read_all(later, BOOT, 0, 99) == ({seq: payload(seq) for seq in range(100)}, set())
    later.close(1.0)
    assert examined(directory, BOOT).findings == []


@pytest.fixture
def _looks_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("onboard.spool.writer.LOOK_S", 0.0)


@pytest.mark.parametrize("gone", ["directory", "segment", "exchanged"])
@pytest.mark.usefixtures("_looks_each_time")
def test_a_spool_that_is_removed_begins_again_with_what_memory_holds(tmp_path: Path, gone: str) -> None:
    directory, told = tmp_path / "state" / "spool", Told()
    filled(directory, 30, 1)
    spool = spool_at(directory, 2, told=told)
    count = 9_000  # more than one read gives
    for seq in range(count):
        spool.append(seq, payload(seq, 40))
        if seq % 1000 == 999:
            until(lambda seq=seq: spool.synced_seq == seq)  # type: ignore[misc]
    if gone == "directory":
        shutil.rmtree(directory.parent)
    elif gone == "exchanged":
        directory.rename(tmp_path / "pulled")
        filled(directory, 7, 9)
    else:
        for file in directory.glob("*.seg"):
            file.unlink()
    spool.append(count, payload(count, 40))
    until(lambda: spool.synced_seq == count)
    spool.close(5.0)
    assert told.codes == ["spool-gone"]
    assert told[0].evidence["count"] == count + 1
    later = spool_at(directory, 3)
    boot = identity(2).boot_id
    assert read_all(later, boot, 0, count) == ({seq: payload(seq, 40) for seq in range(count + 1)}, set())
    assert [run.boot_id for run in later.runs()][-2] == boot, "it is the newest of those before, whatever lay there"
    later.close(1.0)


def test_a_directory_that_cannot_be_synced_while_a_segment_begins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    faults = [OSError(errno.EIO, os.strerror(errno.EIO))]

    def sync(directory: Path) -> None:
        if faults:
            raise faults.pop()
        sync_directory(directory)

    monkeypatch.setattr("onboard.spool.system_calls.sync_directory", sync)
    told = Told()
    spool = spool_at(tmp_path / "spool", told=told)
    for seq in range(20):
        spool.append(seq, payload(seq))
    until(lambda: spool.synced_seq == 19)
    spool.close(5.0)
    assert told.codes == ["spool-failed", "spool-restored"]
    later = spool_at(tmp_path / "spool", 2)
    assert read_all(later, BOOT, 0, 19) == ({seq: payload(seq) for seq in range(20)}, set())
    later.close(1.0)


def test_a_disk_that_is_full_for_a_moment_costs_no_segment(tmp_path: Path) -> None:
    filled(tmp_path / "spool", 500, 1)
    disk, told = FaultyDisk(), Told()
    disk.full_faults = 2
    spool = spool_at(tmp_path / "spool", 2, disk=disk, told=told)
    for seq in range(20):
        spool.append(seq, payload(seq))
    until(lambda: spool.synced_seq == 19)
    spool.close(5.0)
    assert spool.status()["removed"] == 0
    assert told.codes == ["spool-failed", "spool-restored"]
    assert len(read_all(spool_at(tmp_path / "spool", 3), BOOT, 0, 499)[0]) == 500


def test_the_very_first_sync_fails(tmp_path: Path) -> None:
    directory, disk, told = tmp_path / "spool", FaultyDisk(), Told()
    disk.sync_faults = 1
    spool = spool_at(directory, disk=disk, told=told)
    spool.append(0, payload(0))
    until(lambda: spool.synced_seq == 0)
    spool.close(5.0)
    assert len(list(directory.glob("*.seg"))) == 1
    assert told.codes == ["spool-failed", "spool-restored"]


def test_read_only(tmp_path: Path) -> None:
    directory, disk, told = tmp_path / "spool", FaultyDisk(), Told()
    disk.read_only = True
    spool = spool_at(directory, disk=disk, told=told)
    for seq in range(20):
        spool.append(seq, payload(seq))
    assert told.codes == ["spool-failed"]
    assert "Read-only" in told[0].text
    assert spool.status()["fault"] == "Read-only file system"
    assert len(read_all(spool, BOOT, 0, 19)[0]) == 20
    disk.read_only = False
    until(lambda: spool.synced_seq == 19)
    spool.poll()
    assert told.codes == ["spool-failed", "spool-restored"]
    assert spool.status()["fault"] is None
    spool.close(5.0)


def test_read_only_while_it_runs(tmp_path: Path) -> None:
    directory, disk, told = tmp_path / "spool", FaultyDisk(), Told()
    spool = spool_at(directory, disk=disk, told=told)
    for seq in range(60):
        if seq == 20:
            until(lambda: spool.synced_seq == 19)
            disk.read_only = True
        if seq == 40:
            until(lambda: spool.status()["fault"] is not None)
            disk.read_only = False
        spool.append(seq, payload(seq))
    until(lambda: spool.synced_seq == 59)
    spool.close(5.0)
    assert told.codes == ["spool-failed", "spool-restored"]
    later = spool_at(directory, 2)
    assert read_all(later, BOOT, 0, 59) == ({seq: payload(seq) for seq in range(60)}, set())
    later.close(1.0)


def test_a_directory_that_cannot_be(tmp_path: Path) -> None:
    (tmp_path / "spool").write_text("a file")
    told = Told()
    spool = spool_at(tmp_path / "spool", told=told)
    spool.append(0, b"x")
    assert spool.newest() == (0, b"x")
    assert told.codes == ["spool-failed"]
    spool.close(1.0)


def test_closing_does_not_wait_longer_than_asked(tmp_path: Path) -> None:
    disk = FaultyDisk()
    spool = spool_at(tmp_path / "spool", disk=disk)
    disk.gate.clear()
    spool.append(0, b"x")
    begin = time.monotonic()
    spool.close(0.2)
    assert time.monotonic() - begin < 5.0
    disk.gate.set()


def examined(directory: Path, boot_id: str) -> Examination:
    held = [segment for segment in segments_in(directory) if segment.name.boot_id == boot_id]
    examination = Examination(held, is_live=False)
    examination.run()
    return examination


def full_disk(directory: Path, disk: FaultyDisk | None, table: SpoolTable, told: Told) -> None:
    """Three times what fits: streaming goes on, the oldest frames go, one event."""
    filled(directory, 5000, 1, 1000)
    spool = spool_at(directory, 2, disk=disk, table=table, told=told)
    count = 36_000
    for seq in range(count):
        spool.append(seq, payload(seq, 1000))
        if seq % 500 == 0:
            until(lambda seq=seq: spool.synced_seq >= seq - 500)  # type: ignore[misc]
    until(lambda: spool.synced_seq == count - 1)
    assert told.codes == ["spool-full"]
    assert spool.status()["dropped"] == 0
    assert read_all(spool, BOOT, 0, 4999) == ({}, set(range(5000)))
    boot = identity(2).boot_id
    first = spool.runs()[-1].first_seq
    frames, gone = read_all(spool, boot, 0, count - 1)
    assert 0 < first < count - 4000
    assert gone == set(range(first))
    assert all(data == payload(seq, 1000) for seq, data in frames.items())
    spool.close(5.0)
    assert not any(finding.is_damage for finding in examined(directory, boot).findings)


def test_a_full_disk(tmp_path: Path) -> None:
    disk = FaultyDisk()
    disk.room = 7 * MIB
    full_disk(tmp_path / "spool", disk, SpoolTable(max_mib=64, min_free_mib=0, sync_s=0.0), Told())


def test_a_full_file_system(tmp_path: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("a file system of 12 MiB is mounted by root only")
    mount = tmp_path / "small"
    mount.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=12m", "tmpfs", str(mount)], check=True)
    try:
        full_disk(mount / "spool", None, SpoolTable(max_mib=64, min_free_mib=0, sync_s=0.0), Told())
    finally:
        subprocess.run(["umount", "--lazy", str(mount)], check=True)


def test_a_full_disk_with_nothing_of_ours_to_remove(tmp_path: Path) -> None:
    disk, told = FaultyDisk(), Told()
    disk.room = 100
    spool = spool_at(tmp_path / "spool", disk=disk, told=told, table=QUICK)
    for seq in range(30):
        spool.append(seq, payload(seq))
    until(lambda: spool.status()["fault"] is not None)
    assert len(read_all(spool, BOOT, 0, 29)[0]) == 30
    disk.room = 10 * MIB
    until(lambda: spool.synced_seq == 29)
    spool.close(5.0)
    later = spool_at(tmp_path / "spool", 2)
    assert read_all(later, BOOT, 0, 29) == ({seq: payload(seq) for seq in range(30)}, set())
    later.close(1.0)
