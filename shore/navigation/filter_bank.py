"""A bank of filters carried side by side from one checkpoint to the next; all they need to rewind is in a `Moment`."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from common.messages import ImuBlock
from shore.navigation.filters import Filter, FilterState
from shore.navigation.imu_track import TimeStep
from shore.navigation.initial_state import first_state
from shore.navigation.measurements import FirstHeading, Measurement, Position, Seeds, with_courses
from shore.navigation.motion_model import ImuInput
from shore.navigation.sensor_facts import FilterFacts


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


class Bank:
    """The filters of one boat."""

    def __init__(self, filters: Sequence[Filter], facts: FilterFacts, has_compass: bool) -> None:
        self.filters = tuple(filters)
        self.has_compass = has_compass
        self.resets: list[tuple[str, int]] = []
        """Filter and boat time (ns) of each state that was not finite and was thrown away; emptied by the reader."""
        self._facts = facts

    def at_rest(self) -> Moment:
        """Before anything was measured."""
        return Moment(0, (None,) * len(self.filters))

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
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
        states = tuple(
            self._begin(each, t_ns, seeds, shown) if state is None else self._carry(each, state, steps, fused, t_ns)
            for each, state in zip(self.filters, moment.states, strict=True)
        )
        return Moment(t_ns, states, *seeds)

    def _begin(self, each: Filter, t_ns: int, seeds: Seeds, shown: ImuInput | None) -> FilterState | None:
        position, heading = seeds
        if position is None or heading is None:
            return None
        each.start(*first_state(t_ns, position, heading, self._facts, shown))
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
