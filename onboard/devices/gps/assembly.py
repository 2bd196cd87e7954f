"""Sequence assembly: the sentences of one receiver in, complete epochs out.

VTG and GSA carry no time, and some receivers send them before the position. They wait for the next sentence with a
time, or for quiet: of the epoch before or of the one after, by the longest pause among them.

A sentence with a time joins an epoch, opens one, is doubted or set aside (`epoch_times`).
"""

from collections import deque
from typing import Final

from common.units import NS_PER_MS, NS_PER_S
from onboard.devices.driver import Line
from onboard.devices.gps.epoch import QUIET_NS, Epoch, UntimedLine, epoch_of_each, stamp_of
from onboard.devices.gps.epoch_times import EpochTimes, Place, Stamp
from onboard.devices.gps.sentences import Timed, Untimed

SAME_TIME_NS: Final = 500 * NS_PER_MS
"""Age after which the same UTC time in a sentence means that the receiver's time stands still, ns."""
RECENT_NS: Final = 10 * NS_PER_S
"""Time for which RMC rules over ZDA, the epochs rule over the time of ZDA, and a ZDA dates epochs, ns: some receivers
date ZDA ahead (an AC12 by 2 s). After it a follower needs no leader any more."""
MOST_DOUBTED: Final = 16


class Assembly:
    """One receiver's sentences on their way into epochs. Names are talker and formatter (`GPGGA`)."""

    def __init__(self) -> None:
        self.closed: Epoch | None = None
        """The last complete epoch."""
        self.last_ns = 0
        """Boat time of the end of the receiver's last line, ns."""
        self._open: Epoch | None = None
        self._waiting: list[UntimedLine] = []
        self._doubted: deque[Epoch] = deque(maxlen=MOST_DOUBTED)
        """Epochs of a single GLL each that wait for a leader."""
        self._times = EpochTimes()

    def ended(self, t_ns: int) -> None:
        """A line of the receiver has ended, a damaged one too: it is a sign that the burst goes on."""
        self.last_ns = t_ns
        if self._open is not None and not self._waiting:
            self._open.last_ns = max(self._open.last_ns, t_ns)

    def wait(self, name: str, reading: Untimed, line: Line) -> None:
        """Take a sentence without time in."""
        self._waiting.append(UntimedLine(name, reading, line.t_ns, line.end_ns or line.t_ns, self.last_ns))

    def quiet(self, now_ns: int) -> list[Epoch]:
        """The port is quiet: what is complete now."""
        if self._open is None:
            self._waiting.clear()
        self._settle(len(self._waiting))
        return [*self._close(self._open), *self._left_alone(now_ns)]

    def join(self, name: str, reading: Timed, t_ns: int) -> tuple[Epoch | None, list[Epoch]]:
        """The epoch the sentence went into, `None` = it is set aside; and what its coming completed."""
        complete: list[Epoch] = []
        stamp = stamp_of(name, reading, t_ns)
        if stamp is not None:
            self._times.learn(name, stamp.tod_ms)
        # A closed epoch still takes a late sentence: its Fix is out, and a second one would be fused twice.
        epoch = self._open or self.closed
        if epoch is None or not self._belongs(epoch, name, stamp, t_ns):
            place = Place.OPENS if epoch is None else self._place(epoch, name, reading, stamp)
            if place is Place.ASIDE:
                return None, []
            if place is Place.DOUBTED:
                epoch = Epoch(t_ns, t_ns)
                epoch.add(name, reading, stamp)
                self._doubted.append(epoch)
                return None if self._times.is_contradicted(name) else epoch, []
            before = epoch_of_each(self._waiting, self.last_ns, t_ns, open_before=self._open is not None)
            self._settle(before)
            complete = self._judge_doubted(stamp, t_ns)
            first_ns = self._waiting[0].t_ns if self._waiting else t_ns
            epoch = self._open = Epoch(first_ns, t_ns)
        self._settle(len(self._waiting))
        epoch.add(name, reading, stamp)
        if reading.position is not None:
            self._times.had_place(stamp, reading.position.text)
        return epoch, complete

    def _belongs(self, epoch: Epoch, name: str, stamp: Stamp | None, t_ns: int) -> bool:
        """Does a sentence of that time belong here? One without time (cold start) joins what is still going on."""
        if stamp is None or epoch.stamp is None:
            return name not in epoch.seen and t_ns - epoch.last_ns < QUIET_NS
        if name in epoch.seen:
            return stamp.tod_ms == epoch.tod_ms and t_ns - epoch.t_ns < SAME_TIME_NS
        return self._times.are_one(epoch.stamp, stamp)

    def _place(self, epoch: Epoch, name: str, reading: Timed, stamp: Stamp | None) -> Place:
        """What to do with a sentence that does not belong to the newest epoch."""
        if stamp is None or epoch.stamp is None or stamp.t_ns - epoch.t_ns >= RECENT_NS:
            return Place.OPENS
        place = None if reading.position is None else reading.position.text
        return self._times.place_of(name, stamp, place, epoch.stamp)

    def _judge_doubted(self, leader: Stamp | None, t_ns: int) -> list[Epoch]:
        """The open epoch, which is complete now, and the doubted ones that a leader confirms; the others are lost."""
        doubted = [epoch for epoch in self._doubted if t_ns - epoch.t_ns < RECENT_NS]
        self._doubted.clear()
        stamp = None if self._open is None else self._open.stamp
        opened_by_follower = stamp is not None and leader is not None and stamp.rank < leader.rank
        # A follower opens one before any leader is known, and once it was confirmed.
        if opened_by_follower and not self._is_confirmed(self._open, leader):
            self._open = None
        complete = self._close(self._open)
        for epoch in doubted:
            if self._is_confirmed(epoch, leader):
                complete += self._close(epoch)
        return complete

    def _left_alone(self, now_ns: int) -> list[Epoch]:
        """Doubted epochs that no leader has followed for 10 s, if the last that was judged was right."""
        complete: list[Epoch] = []
        while self._doubted and now_ns - self._doubted[0].t_ns >= RECENT_NS:
            epoch = self._doubted.popleft()
            if all(map(self._times.is_confirmed, epoch.seen)):
                complete += self._close(epoch)
        return complete

    def _is_confirmed(self, epoch: Epoch | None, leader: Stamp | None) -> bool:
        if epoch is None or epoch.stamp is None or leader is None:
            return False
        return self._times.confirms(epoch.seen, epoch.stamp, leader)

    def _settle(self, count: int) -> None:
        """The first `count` of the waiting sentences belong to the open epoch."""
        settled, self._waiting = self._waiting[:count], self._waiting[count:]
        if self._open is not None:
            for line in settled:
                self._open.add(line.name, line.reading, None)

    def _close(self, epoch: Epoch | None) -> list[Epoch]:
        self._open = None
        if epoch is None:
            return []
        self.closed = epoch
        return [epoch]
