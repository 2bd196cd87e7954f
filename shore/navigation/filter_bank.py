"""A bank of filters carried side by side from one checkpoint to the next; all they need to rewind is in a `Moment`."""

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from common.messages import ImuBlock
from common.units import NS_PER_S
from shore.navigation.filters import Filter, FilterState
from shore.navigation.imu_track import TimeStep
from shore.navigation.initial_state import first_state
from shore.navigation.measurements import Course, FirstHeading, Measurement, Position, Seeds, with_courses
from shore.navigation.motion_model import ImuInput

LONGEST_WAIT_NS: Final = 5 * NS_PER_S
"""A boat whose compass says nothing for this time is shown without a heading."""


class Batch(NamedTuple):
    """What one frame brings, converted."""

    t1_ns: int
    """Boat time of the end of the frame, ns."""
    boot_id: str
    measurements: tuple[Measurement, ...]
    blocks: tuple[ImuBlock, ...]
    """Samples of the IMU that the filters use."""


class Moment(NamedTuple):
    """The memory of all filters at one time; immutable."""

    t_ns: int
    states: tuple[FilterState | None, ...]
    """State of each filter; `None` = the filter waits for its start."""
    position: Position | None = None
    """The newest position so far; filters start from it and from the newest heading."""
    heading: FirstHeading | None = None
    placed_ns: int | None = None
    """Boat time of the first position, ns."""
    fixed_since_ns: int | None = None
    """Boat time of the first position of the row, unbroken by a silence, that the newest one belongs to, ns."""


not_finite_is_found = np.errstate(over="ignore", invalid="ignore", divide="ignore")
"""What calls `Bank.advance` is decorated with it: a state that is not finite is found by the bank, without warnings."""


class Bank:
    """The filters of one boat."""

    def __init__(self, filters: Sequence[Filter], has_compass: bool, lost_after_ns: int = LONGEST_WAIT_NS) -> None:
        """lost_after_ns: a longer silence of the receivers ends a row of positions."""
        self.filters = tuple(filters)
        self.has_compass = has_compass
        self._lost_after_ns = lost_after_ns
        self.resets: list[tuple[str, int]] = []
        """Filter and boat time (ns) of each state that was not finite and was thrown away; emptied by the reader."""

    def at_rest(self) -> Moment:
        """Before anything was measured."""
        return Moment(0, (None,) * len(self.filters))

    def advance(
        self,
        moment: Moment,
        t_ns: int,
        steps: Sequence[TimeStep],
        measurements: Iterable[Measurement] = (),
        shown: ImuInput | None = None,
    ) -> Moment:
        """Predict along `steps`, fuse what was measured at `t_ns`, start filters that can be started.

        `shown`: mean of the IMU just before `t_ns`, for the filters that start.
        """
        fused = tuple(measurements if self.has_compass else with_courses(measurements))
        seeds = Seeds(moment.position, moment.heading)
        for measured in fused:
            seeds = measured.seed(seeds)
        placed_ns = t_ns if moment.placed_ns is None and seeds.position is not None else moment.placed_ns
        is_patient = self.has_compass and placed_ns is not None and t_ns - placed_ns < LONGEST_WAIT_NS
        states = tuple(
            self._begin(each, t_ns, seeds, shown, is_patient)
            if state is None
            else self._carry(each, state, steps, fused, t_ns)
            for each, state in zip(self.filters, moment.states, strict=True)
        )
        return Moment(t_ns, states, *seeds, placed_ns, self._fixed_since_ns(moment, seeds.position))

    def _fixed_since_ns(self, moment: Moment, position: Position | None) -> int | None:
        before = moment.position
        if position is None or position is before:
            return moment.fixed_since_ns
        is_broken = before is None or position.t_ns - before.t_ns > self._lost_after_ns
        return position.t_ns if is_broken else moment.fixed_since_ns

    def _begin(
        self, each: Filter, t_ns: int, seeds: Seeds, shown: ImuInput | None, is_patient: bool
    ) -> FilterState | None:
        """Start a filter; that of a real boat does without a heading when no compass speaks."""
        position, heading = seeds
        if each.facts.boat is not None and isinstance(heading, Course):
            heading = None
        if position is None or (heading is None and (is_patient or each.facts.boat is None)):
            return None
        each.start(*first_state(t_ns, position, heading, each.facts, shown))
        return each.snapshot()

    def _carry(
        self,
        each: Filter,
        state: FilterState,
        steps: Sequence[TimeStep],
        fused: tuple[Measurement, ...],
        t_ns: int,
    ) -> FilterState | None:
        """The state after prediction and fusion; `None` when it is no longer finite, which is recorded."""
        each.restore(state)
        for step in steps:
            each.predict(step.dt_s, step.imu)
        for measured in fused:
            each.update(measured)
        after = each.snapshot()
        if after.healthy:
            return after
        self.resets.append((each.name, t_ns))
        return None
