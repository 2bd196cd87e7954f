"""Which start of the board a frame belongs to, and whether that is an older or a newer one (boot ordering).

Boat times can be compared only within one `clock_id` (one boot of the board). Which of two clocks is the newer one the
board itself says: its greeting lists the starts it holds, the oldest first, its own last. Where no greeting names both,
`start_no` decides, which counts the starts of the daemon; a damaged card or an older backup may set that count back.
"""

from collections.abc import Iterable
from operator import attrgetter
from typing import Any, NamedTuple, Self

from common.messages import Frame


class BoatStart(NamedTuple):
    """A start of the board's daemon."""

    clock_id: str
    boot_id: str
    start_no: int

    @classmethod
    def of(cls, frame: Frame) -> Self:
        """The start that made the frame."""
        return cls(frame.clock_id, frame.boot_id, frame.start_no)


class StartOrder:
    """The order of a board's starts, as its greetings say it."""

    def __init__(self) -> None:
        self._ranks: dict[str, int] = {}

    def greeted(self, boot_ids: Iterable[str]) -> None:
        """A greeting named these starts, the oldest first, the one that runs last.

        Others that are known stay behind the one that they followed, and are older than the one that runs.
        """
        *held, runs = dict.fromkeys(boot_ids) or (None,)
        if runs is None:
            return
        order = dict.fromkeys(held)
        behind: dict[str | None, list[str]] = {}
        before = None
        for boot_id in self._ranks:
            if boot_id in order:
                before = boot_id
            elif boot_id != runs:
                behind.setdefault(before, []).append(boot_id)
        merged = (each for boot_id in (None, *held) for each in (boot_id, *behind.get(boot_id, ())))
        ranked = (*(boot_id for boot_id in merged if boot_id is not None), runs)
        self._ranks = {boot_id: rank for rank, boot_id in enumerate(ranked)}

    def is_before(self, start: BoatStart, other: BoatStart) -> bool:
        """True for a start that was over when `other` began."""
        rank, other_rank = self._ranks.get(start.boot_id), self._ranks.get(other.boot_id)
        if rank is None or other_rank is None:
            return start.start_no < other.start_no
        return rank < other_rank

    def sorted(self, starts: Iterable[BoatStart]) -> list[BoatStart]:
        """The oldest first; starts of which none is before the other stay as they are."""
        given = sorted(starts, key=attrgetter("start_no"))
        order = sorted((each for each in given if each.boot_id in self._ranks), key=lambda it: self._ranks[it.boot_id])
        for start in given:
            if start.boot_id not in self._ranks:
                place = next((at for at, other in enumerate(order) if start.start_no < other.start_no), len(order))
                order.insert(place, start)
        return order


def boots_named(runs: Any) -> tuple[str, ...]:
    """The boot_ids in the `runs` of a greeting, in its order; none where that has another form."""
    if not isinstance(runs, list | tuple):
        return ()
    return tuple(run[0] for run in runs if isinstance(run, list | tuple) and run and isinstance(run[0], str))
