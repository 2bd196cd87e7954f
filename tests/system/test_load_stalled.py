"""A client that stops reading costs the board no memory, and the others nothing."""

import os
import signal
import statistics
import sys
import threading
import time
from pathlib import Path

import pytest
import zmq

from benchmarks.observer import child, kilobytes
from benchmarks.stations import Station
from common import link_messages as session
from common.link_messages import FrameRange, Lease

SECONDS = 30.0
SETTLED_S = 8.0
"""By then what the first seconds fill is filled, and who does not read is cut off."""
GROWTH_KB = 2_000
"""In the 22 s after that. A board that kept for them what they do not read would keep 35 to 1000 kB a second."""


class Liar(threading.Thread):
    """Asks for everything a hundred times a second, says that it all came, and never reads."""

    def __init__(self, address: str, boot_id: str) -> None:
        super().__init__(daemon=True)
        self.address, self.boot_id = address, boot_id
        self.ended = threading.Event()

    def run(self) -> None:
        everything = (FrameRange(self.boot_id, 0, 2**40),) * session.MAX_MISSING
        with zmq.Context() as context, context.socket(zmq.DEALER) as dealer:
            for option, value in ((zmq.LINGER, 0), (zmq.RCVHWM, 1), (zmq.SNDTIMEO, 100), (zmq.RCVBUF, 4096)):
                dealer.setsockopt(option, value)
            dealer.connect(self.address)
            number = 0
            while not self.ended.wait(0.01):
                number += 1
                lease = Lease("bad", self.boot_id, session.MAX_WINDOW, number * 10**9, 0, everything)
                try:
                    dealer.send(session.pack("lease", **lease.as_fields()))
                except zmq.Again:
                    continue


@pytest.mark.in_pairs
@pytest.mark.slow
def test_clients_that_stop_reading_cost_no_memory_and_no_frame_of_others(tmp_path: Path) -> None:
    with child(sys.executable, "-m", "benchmarks.board", str(tmp_path), "--history", "2600") as board:
        ready = board.line()
        pid = board.process.pid
        with child(sys.executable, "-m", "benchmarks.stations", ready["bind"]) as stopped:
            stopped.line()
            honest = Station(ready["bind"], ready)
            honest.start()
            time.sleep(3.0)
            alone_s = (time.clock_gettime(time.CLOCK_BOOTTIME) - 2.0, time.clock_gettime(time.CLOCK_BOOTTIME))
            os.kill(stopped.process.pid, signal.SIGSTOP)
            liar = Liar(ready["bind"], ready["boot_id"])
            liar.start()
            began_s, samples = time.monotonic(), []
            while (age_s := time.monotonic() - began_s) < SECONDS:
                samples.append((age_s, kilobytes(pid, "status", "VmRSS:")))
                time.sleep(0.25)
            end_s = time.clock_gettime(time.CLOCK_BOOTTIME)
            liar.ended.set()
            liar.join()
            os.kill(stopped.process.pid, signal.SIGCONT)
            stopped.process.kill()
        time.sleep(0.3)
        honest.stop()
        settled = [sample for sample in samples if sample[0] > SETTLED_S]
        slope_kb_s = statistics.linear_regression([t for t, _ in settled], [kb for _, kb in settled]).slope
        before_ms = sorted(ms for _, ms in honest.live_ms(*alone_s))
        during_ms = sorted(ms for _, ms in honest.live_ms(alone_s[1], end_s))
        seqs = [item.seq for item in honest.arrivals]
        print(
            f"\n  stalled: RSS {settled[0][1]} -> {settled[-1][1]} kB, slope {slope_kb_s * 60:.0f} kB/min; latency"
            f" alone {before_ms[len(before_ms) // 2]:.1f} ms, beside them {during_ms[len(during_ms) // 2]:.1f} ms, p99"
            f" {during_ms[int(0.99 * len(during_ms))]:.1f} ms; {honest.lost(min(seqs), max(seqs))} frames missing"
        )
        assert honest.lost(min(seqs), max(seqs)) == 0
        assert len(seqs) > 20 * SECONDS
        assert settled[-1][1] - settled[0][1] < GROWTH_KB
        assert during_ms[len(during_ms) // 2] < before_ms[len(before_ms) // 2] + 10.0
        assert during_ms[int(0.99 * len(during_ms))] < 100.0
