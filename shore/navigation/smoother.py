"""RTS smoother: estimates that know what was measured afterwards, behind any filter of the registry.

Rauch, Tung, Striebel, *Maximum likelihood estimates of linear dynamic systems* (1965), in a form that can be composed
(Sarkka, Garcia-Fernandez, *Temporal parallelization of Bayesian smoothers*, 2021). Letters as in `kalman`; y is the
state at a later time. Given y and all that was measured before it, the earlier state is Gaussian with

    mean x + E (y - b),  covariance L.

Over one prediction b is the predicted state, E = C P^-1 with the predicted P and C = cov(before, after), and
L = P before - E C^T. Backwards, the smoothed y gives the covariance L + E P_y E^T, a sum of what cannot be negative.

Two links, whatever is measured between them, make one (`RtsLink.then`). So memory grows with the times that are kept
and not with the rate of the IMU: 2.3 kB each for nine states, 82 MB an hour at ten a second.
"""

from bisect import bisect_right
from typing import Final, NamedTuple

import numpy as np

from shore.navigation.filter_registry import build_filter
from shore.navigation.filters import FilterState
from shore.navigation.kalman import Predicted, symmetric, wrap_heading
from shore.navigation.numbers import Array, clip, part
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.state_space import Gaussian


class RtsLink(NamedTuple):
    """What an earlier state is when a later one is known."""

    x: Array
    """The earlier state, given all that was measured before the later one, (..., n)."""
    E: Array
    """Smoother gain: how the earlier state follows when the later one moves, (..., n, n)."""
    L: Array
    """Covariance of the earlier state when the later one is known, (..., n, n)."""
    b: Array
    """The later state as it was predicted, (..., n)."""

    def then(self, following: "RtsLink") -> "RtsLink":
        """Link from the earlier state of this one to the later state of the next, which begins where this one ends."""
        x = self._at(following.x)
        L = self.L + self.E @ following.L @ self.E.swapaxes(-1, -2)
        return RtsLink(x, self.E @ following.E, L, following.b)

    def back(self, later: Gaussian) -> Gaussian:
        """The earlier state when the later one has been smoothed."""
        P = self.L + self.E @ later.P @ self.E.swapaxes(-1, -2)
        return Gaussian(later.space, wrap_heading(self._at(later.x)), symmetric(P))

    def _at(self, later: Array) -> Array:
        apart = wrap_heading(later - self.b)
        x: Array = self.x + (self.E @ apart[..., np.newaxis])[..., 0]
        return x


def link_of(before: FilterState, predicted: Predicted) -> RtsLink:
    """The link of one prediction."""
    cross = predicted.cross
    E = _gain(predicted.P, cross)
    L = symmetric(before.P - E @ cross.swapaxes(-1, -2))
    return RtsLink(before.x, E, L, predicted.x)


def _gain(P: Array, cross: Array) -> Array:
    """E = C P^-1, (..., n, n), by way of correlations, since metres and radians differ by orders of magnitude."""
    diagonal = P.diagonal(axis1=-2, axis2=-1)
    sigma = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    columns = sigma[..., np.newaxis, :]
    correlation = P / (sigma[..., :, np.newaxis] * columns)
    target = (cross / columns).swapaxes(-1, -2)
    try:
        solved = np.linalg.solve(correlation, target)
    except np.linalg.LinAlgError:  # a state that is known, or two that are one
        solved = np.linalg.pinv(correlation, hermitian=True) @ target
    E: Array = solved.swapaxes(-1, -2) / columns
    return E


class Smoother:
    """One filter of the registry, and the smoothed states of the moments named by `keep`; it goes forward only.

    Raises: WayfixError for an unknown name.
    """

    def __init__(self, name: str, facts: FilterFacts) -> None:
        self.filter: Final = build_filter(name, facts, observer=self)
        self._passed = 0
        """Predictions since the start."""
        self._marks: list[int] = []
        """Predictions before each kept moment."""
        self._links: dict[int, RtsLink] = {}
        """From a mark to the next, or to now."""
        self._newest: Gaussian | None = None
        """What was believed at the last mark."""

    def keep(self) -> None:
        """The state of this moment is to be smoothed; what is measured at the same moment may follow."""
        self._marks.append(self._passed)
        self._newest = self.filter.estimate.gaussian

    def smoothed(self) -> list[Gaussian]:
        """The kept moments in order, with all that has been measured so far; limited states within their limits.

        After numbers that are not finite: with what had been measured up to the last kept moment.
        """
        later, links = self.filter.estimate.gaussian, self._links
        if self._newest is not None and not np.isfinite(later.x).all():
            later = self._newest
            links = {mark: link for mark, link in links.items() if mark < self._marks[-1]}
        moments = {}
        for mark in sorted(set(self._marks), reverse=True):
            if mark in links:
                later = links[mark].back(later)
            moments[mark] = _limited(later)
        return [moments[mark] for mark in self._marks]

    def started(self) -> None:
        """The filter has started: nothing is kept of what was before."""
        self._passed = 0
        self._marks.clear()
        self._links.clear()

    def passed(self, before: FilterState, predicted: Predicted) -> None:
        """The filter has made a prediction."""
        place = bisect_right(self._marks, self._passed)
        if place:
            mark, link = self._marks[place - 1], link_of(before, predicted)
            self._links[mark] = self._links[mark].then(link) if mark in self._links else link
        self._passed += 1

    def repeats(self) -> None:
        """All predictions since the start come once more, and replace what was recorded of them."""
        self._passed = 0
        self._links.clear()


def _limited(state: Gaussian) -> Gaussian:
    """Within the limits of the state space, which the smoother's straight lines do not know."""
    x = state.x.copy()
    for place, limit in state.space.limits:
        x[..., place] = clip(part(x, place), -limit, limit)
    return state._replace(x=x)
