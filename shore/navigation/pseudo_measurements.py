"""Pseudo-measurements of the water: what is known of it without a sensor; optional, it bounds the drift of an outage.

A field says how the water flows; a boat goes through it where its bow points, with the way that its thrust keeps up.
All of it is wrong for a while in the same sense. Fused each second as if every time were independent it would claim
far too much. So what is wrong by sigma within T is fused as the white noise that tells as little, 2 sigma^2 T / dt.
A state that wanders by sigma / sqrt(T) and is given its value with sigma^2 T / dt keeps the doubt sigma and forgets
within T what it differed by. The way itself is never given: the filter finds it while it has fixes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

from common.simulation.fields import VectorField
from shore.navigation.filters import Filter
from shore.navigation.measurements import PseudoPart, PseudoScalar
from shore.navigation.numbers import Array, Number, part
from shore.navigation.sailing import Sailing
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.state_space import EAST, NORTH, Extra, StateSpace


class Stream(NamedTuple):
    """The current that a field gives at the estimated place: it changes as the field does, what it differs by fades."""

    east_m_s: Number
    north_m_s: Number
    change_east_m_s: Number
    """How much the current has changed since the last time, at the place estimated then."""
    change_north_m_s: Number
    variance: float
    """Variance R of each axis, m^2/s^2."""

    @property
    def parts(self) -> tuple[PseudoPart, ...]:
        """East, then north, where the current is a state."""
        return self._east, self._north

    def _east(self, space: StateSpace, x: Array) -> PseudoScalar | None:
        return self._axis(space.index("current_east_m_s"), x, self.east_m_s, self.change_east_m_s)

    def _north(self, space: StateSpace, x: Array) -> PseudoScalar | None:
        return self._axis(space.index("current_north_m_s"), x, self.north_m_s, self.change_north_m_s)

    def _axis(self, place: int | None, x: Array, value: Number, change: Number) -> PseudoScalar | None:
        if place is None:
            return None
        changed = x.copy()
        changed[..., place] += change
        return PseudoScalar(changed, ((place, 1.0),), value - part(changed, place), self.variance)


@dataclass(frozen=True, slots=True, kw_only=True)
class Water:
    """What a filter is given about the water; all numbers are 1-sigma."""

    field: VectorField | None = None
    """Velocity of the water by place on the filter's plane and time; `None` = unknown: it wanders by `walk_m_s`."""
    field_error_m_s: float = 0.1
    """Error of the field on each axis, m/s: an atlas of tides, a model's grid."""
    field_error_s: float = 600.0
    """Time for which a field stays wrong in the same sense, s."""
    walk_m_s: float = 0.01
    """Density of the current's random walk, m/s / sqrt(s): 0.5 m/s in 40 min."""
    largest_m_s: float = 0.5
    """1-sigma of the current on each axis before anything is known, m/s."""
    leeway_m_s: float = 0.05
    """Speed athwart through the water, m/s: wind, waves, turns."""
    leeway_s: float = 60.0
    surge_m_s: float = 0.05
    """Speed ahead about the way, m/s: waves, helm."""
    surge_s: float = 10.0
    largest_way_m_s: float = 2.0
    """1-sigma of the way before anything is known, m/s."""
    way_m_s: float = 0.1
    """Change of the way, mostly by wind, m/s, within `way_s`."""
    way_s: float = 300.0
    """Time within which the way changes by `way_m_s`, s."""

    def told(self, facts: FilterFacts) -> FilterFacts:
        """The facts with current and way as states."""
        walk = self.walk_m_s if self.field is None else self.field_error_m_s / math.sqrt(self.field_error_s)
        water = (
            Extra("current_east_m_s", self.largest_m_s, walk),
            Extra("current_north_m_s", self.largest_m_s, walk),
            Extra("way_m_s", self.largest_way_m_s, self.way_m_s / math.sqrt(self.way_s)),
        )
        return replace(facts, space=StateSpace((*facts.space.extras, *water)))

    def predict(self, each: Filter, t_s: float, dt_s: float, predict: Callable[[], object]) -> None:
        """Let `predict` move a filter on by `dt_s` to `t_s` of the field's time, and give it what is known there."""
        before = each.estimate.x
        predict()
        if self.field is not None:
            was, now = self._flow(before, t_s - dt_s), self._flow(each.estimate.x, t_s)
            variance = self.field_error_m_s**2 * self.field_error_s / dt_s
            each.assume(Stream(*now, now[0] - was[0], now[1] - was[1], variance))
        athwart = 2.0 * self.leeway_m_s**2 * self.leeway_s / dt_s
        each.assume(Sailing(athwart, 2.0 * self.surge_m_s**2 * self.surge_s / dt_s))

    def _flow(self, x: Array, t_s: float) -> tuple[Number, Number]:
        assert self.field is not None
        return self.field(part(x, EAST), part(x, NORTH), t_s)
