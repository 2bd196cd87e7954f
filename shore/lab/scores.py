"""Scores of the methods (MSE, NEES, NIS) for tables, the JSON line and the page of the thesis."""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from shore.lab.batch import Outcome
from shore.lab.methods import METHODS
from shore.lab.parallel_runs import RAW, Result
from shore.lab.statistics import COMPONENTS, IntervalEstimate, mean_of, oddness, ratio_of
from shore.lab.thesis_published import PUBLISHED, RAW_AFTER_CHANGE
from shore.navigation.numbers import Array

WHOLE: Final = "whole"
ODD: Final = 2.0
"""Limit of |z|: a published value below it is within the spread of one run."""

LEAST_RUNS_FOR_Z: Final = 10
"""Least number of runs from which the spread of single runs is known."""


@dataclass(frozen=True, slots=True)
class MethodScore:
    """One method on one scenario; tuples are east, north, heading in the units of `COMPONENTS`."""

    mse: tuple[IntervalEstimate, ...]
    """Mean squared error over the runs."""
    sd: tuple[float, ...]
    """Standard deviation of the MSE of one run."""
    ratio: tuple[IntervalEstimate, ...]
    """Mean MSE / mean MSE of the reference, same runs."""
    to_bound: tuple[float, ...]
    """Mean MSE / Cramer-Rao bound; NaN for a method that is given the biases which the bound's filter has to find."""
    anees: float
    """Average normalised estimation error squared over steps and runs; 5 expected."""
    anis: float
    """Average normalised innovation squared, for three measured numbers a step; 3 expected, NaN without innovations."""
    us_per_step: float
    """Processor time of the batch, for each run and step, us."""
    live_us: float
    """Processor time of one boat, for each step, us."""


def score(result: Result, method: str, span: str = WHOLE) -> MethodScore:
    """The figures of a method over a stretch of the run; consistency and times are of the whole run."""
    outcome = result.outcomes[method]
    samples = outcome.mse[span]
    bound = np.array(bound_of(result, span))
    if result.setting.biased and method != RAW and METHODS[method].knows_bias:
        bound = np.full(len(bound), np.nan)
    estimates = tuple(mean_of(samples[:, each]) for each in range(3))
    return MethodScore(
        mse=estimates,
        sd=tuple(samples.std(axis=0, ddof=1).tolist()),
        ratio=tuple(ratio_of(samples[:, each], result.reference.mse[span][:, each]) for each in range(3)),
        to_bound=tuple(estimate.value / least for estimate, least in zip(estimates, bound.tolist(), strict=True)),
        anees=float(outcome.nees.mean()),
        anis=float(outcome.nis.mean()),
        us_per_step=outcome.seconds * 1e6 / (result.runs * (len(result.bound) - 1)),
        live_us=outcome.live_us,
    )


def bound_of(result: Result, span: str = WHOLE) -> tuple[float, ...]:
    """The bound, averaged over the steps as the squared errors are."""
    return tuple(result.bound[result.setting.spans[span]].mean(axis=0).tolist())


@dataclass(frozen=True, slots=True)
class ThesisComparison:
    """What the thesis prints for a method, and how odd that is among our runs."""

    method: str
    published: tuple[float, ...]
    z: tuple[float, ...]
    """How odd each is among our single runs (`statistics.oddness`); NaN with less than `LEAST_RUNS_FOR_Z` runs."""


def comparisons(result: Result) -> list[ThesisComparison]:
    """Comparisons with each printed row whose method was run."""
    printed = PUBLISHED.get(result.name)
    found = []
    for method, row in printed.rows.items() if printed else ():
        if method not in result.outcomes:
            continue
        span = "after" if method == RAW and result.name in RAW_AFTER_CHANGE else WHOLE
        samples = result.outcomes[method].mse[span]
        known = result.runs >= LEAST_RUNS_FOR_Z
        z = tuple(oddness(row[each], samples[:, each]) if known else math.nan for each in range(3))
        found.append(ThesisComparison(method, row, z))
    return found


def as_json(result: Result) -> dict[str, Any]:
    """The object of `lab run --json`; a number that does not exist is null, `ci95` is [low, high].

    `ratio_to_oracle` is taken with the method `reference`: `static` where the boat is moored.
    """
    printed = PUBLISHED.get(result.name)
    return {
        "scenario": result.name,
        "runs": result.runs,
        "seed": result.seed,
        "profile": result.setting.profile,
        "reference": result.setting.reference,
        "results": {method: _method_json(score(result, method)) for method in result.asked},
        "bound": _named(bound_of(result)),
        "published": {method: _named(row) for method, row in printed.rows.items()} if printed else {},
    }


def _method_json(scored: MethodScore) -> dict[str, Any]:
    return {
        "mse": _named(tuple(each.value for each in scored.mse)),
        "ci95": {
            name: [number(each.interval.low), number(each.interval.high)]
            for name, each in zip(COMPONENTS, scored.mse, strict=True)
        },
        "ratio_to_oracle": _named(tuple(each.value for each in scored.ratio)),
        "anees": number(scored.anees),
        "anis": number(scored.anis),
        "us_per_step": number(scored.us_per_step),
    }


def _named(values: tuple[float, ...]) -> dict[str, float | None]:
    return {name: number(value) for name, value in zip(COMPONENTS, values, strict=True)}


def number(value: float) -> float | None:
    """Six significant digits; `None` for what is not finite."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def claimed_sigma(outcome: Outcome, runs: int) -> Array:
    """RMS over steps and runs of the 1-sigma that a method claims, (3,): m, m, deg."""
    root: Array = np.sqrt(outcome.claimed[1:].mean(axis=0) / runs)
    return root
