"""Append, read, retention, restart in any order against a dictionary of everything there ever was."""

import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from onboard.spool import Spool, writer
from onboard.spool import segment_index as shelf
from onboard.spool import shared_state as spool_state
from tests.link.spooling import FaultyDisk, Told, identity, payload, read_all, spool_at, until

SEGMENT = 6000
RING = 3000
MOST = 5 * SEGMENT


class SpoolModel(RuleBasedStateMachine):
    """Frames that were synced or are new must be there, unless retention took them; nothing wrong ever is."""

    def __init__(self) -> None:
        super().__init__()
        self.patch = pytest.MonkeyPatch()
        for module in (shelf, writer):
            self.patch.setattr(module, "SEGMENT_BYTES", SEGMENT)
        self.patch.setattr(spool_state, "RING_BYTES", RING)
        self.patch.setattr(writer, "MIB", MOST // 16)  # QUICK says 16 MiB
        self.directory = Path(tempfile.mkdtemp(prefix="spool-model-"))
        self.made: dict[str, dict[int, bytes]] = {}
        self.start_no = 0
        self.next_seq = 0
        self.spool: Spool | None = None

    @initialize()
    def begin(self) -> None:
        self.start()

    def start(self) -> None:
        self.start_no += 1
        self.disk = FaultyDisk()
        self.told = Told()
        self.spool = spool_at(self.directory / "spool", self.start_no, disk=self.disk, told=self.told)
        self.boot = identity(self.start_no).boot_id
        self.made[self.boot] = {}
        self.next_seq = 0

    @rule(count=st.integers(1, 40), size=st.integers(0, 900), hole=st.booleans())
    def append(self, count: int, size: int, hole: bool) -> None:
        assert self.spool is not None
        self.next_seq += hole
        for _ in range(count):
            data = payload(self.next_seq, size)
            self.spool.append(self.next_seq, data)
            self.made[self.boot][self.next_seq] = data
            self.next_seq += 1

    @rule()
    def settle(self) -> None:
        self.wait()

    def wait(self) -> None:
        spool = self.spool
        assert spool is not None
        newest = spool.newest()
        if newest is not None:
            until(lambda: spool.synced_seq == newest[0])

    @rule()
    def sync_fails_once(self) -> None:
        self.disk.sync_faults = 1

    @rule()
    def restart(self) -> None:
        assert self.spool is not None
        self.disk.sync_faults = 0
        self.wait()
        self.spool.close(20.0)
        self.start()

    @precondition(lambda self: self.made[self.boot])
    @rule(data=st.data(), max_bytes=st.integers(1, 5000))
    def read_a_part(self, data: st.DataObject, max_bytes: int) -> None:
        assert self.spool is not None
        boot = data.draw(st.sampled_from(sorted(self.made)))
        first = data.draw(st.integers(0, 200))
        self.check(boot, first, first + data.draw(st.integers(0, 300)), max_bytes, is_quiet=False)

    @invariant()
    def everything_is_as_it_should_be(self) -> None:
        if self.spool is not None:
            self.wait()
            for run in self.spool.runs():
                assert run.start_no == int(run.boot_id, 16)
                self.check(run.boot_id, 0, run.next_seq + 2, 2000, is_quiet=True)
            files = (self.directory / "spool").glob("*.seg")
            assert sum(path.stat().st_size for path in files) <= MOST

    def check(self, boot: str, first: int, last: int, max_bytes: int, *, is_quiet: bool) -> None:
        assert self.spool is not None
        runs = {run.boot_id: run for run in self.spool.runs()}
        frames, gone = read_all(self.spool, boot, first, last, max_bytes)
        made = self.made[boot]
        assert all(made.get(seq) == data for seq, data in frames.items())
        end = max(made, default=-1) if boot == self.boot else last
        assert frames.keys() | gone == set(range(first, min(last, end) + 1))
        wrongly_gone = gone & made.keys()
        if is_quiet and boot in runs:  # only the oldest go: what is gone is older than all that is there
            assert all(seq < min(frames, default=last + 1) for seq in wrongly_gone)
        newest = [seq for seq in sorted(made) if boot == self.boot][-3:]
        assert not gone & set(newest)

    def teardown(self) -> None:
        if self.spool is not None:
            self.disk.sync_faults = 0
            self.spool.close(20.0)
        self.patch.undo()
        shutil.rmtree(self.directory)


TestSpoolModel = SpoolModel.TestCase
TestSpoolModel.settings = settings(max_examples=25, stateful_step_count=25, deadline=None)
