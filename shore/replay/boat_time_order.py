"""External sort of a log's frames by boat time; their bytes wait in a temporary file, so that memory stays small."""

from array import array
from collections.abc import Iterator
from tempfile import SpooledTemporaryFile
from typing import Final

import numpy as np

from common.boat_start import BoatStart, StartOrder
from common.errors import WayfixError
from common.messages import Frame

IN_MEMORY: Final = 64 * 2**20
"""Most bytes of frames in memory; more of them go to the disk."""


class FramesByTime:
    """Takes frames in any order and gives their bytes sorted by boat time; 40 bytes each stay in memory.

    Clocks that cannot be compared follow each other in the order of the daemon's starts. `group` travels along.
    """

    def __init__(self) -> None:
        self._file = SpooledTemporaryFile(max_size=IN_MEMORY)  # noqa: SIM115 (closed with this object)
        self._clocks: dict[str, int] = {}
        """Number of each clock in order of arrival, by clock_id."""
        self._starts: list[BoatStart] = []
        """One start of each clock, by number of the clock; the starts of different clocks do not mix."""
        self._clock, self._t1_ns, self._seq, self._stop, self._group = (array("q") for _ in range(5))

    def __len__(self) -> int:
        return len(self._t1_ns)

    def add(self, data: bytes, frame: Frame, group: int) -> None:
        """One frame's bytes and the same decoded; raises WayfixError when the disk is full."""
        number = self._clocks.setdefault(frame.clock_id, len(self._clocks))
        if number == len(self._starts):
            self._starts.append(BoatStart.of(frame))
        try:
            self._file.write(data)
        except OSError as error:
            cure = "free some space there, or name another directory in TMPDIR"
            raise WayfixError(f"frames cannot be put in order ({error.strerror})", "temporary files", cure) from error
        self._clock.append(number)
        self._t1_ns.append(frame.t1_ns)
        self._seq.append(frame.seq)
        self._stop.append(self._file.tell())
        self._group.append(group)

    def sorted(self, starts: StartOrder) -> Iterator[tuple[bytes, int]]:
        """(bytes, group) of each frame, sorted by clock, `t1_ns` and `seq`."""
        if not self._t1_ns:
            return
        clocks = [self._clocks[start.clock_id] for start in starts.sorted(self._starts)]
        place = np.argsort(clocks)
        order = np.lexsort((self._seq, self._t1_ns, place[np.asarray(self._clock)]))
        for index in order.tolist():
            start = self._stop[index - 1] if index else 0
            self._file.seek(start)
            yield self._file.read(self._stop[index] - start), self._group[index]

    def close(self) -> None:
        """Release the temporary file."""
        self._file.close()
