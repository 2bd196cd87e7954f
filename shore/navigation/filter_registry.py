"""Filters by name (registry): which prediction goes with which rule for R; fixed or adaptive, linear to unscented."""

from collections.abc import Mapping
from typing import Final

from common.errors import WayfixError
from shore.navigation.filters import Filter, Observer, Predict
from shore.navigation.judge import Judge
from shore.navigation.kalman import predict_extended, predict_linear
from shore.navigation.noise.rules import NOISE_RULES
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.ukf import predict_unscented

REGISTRY: Final[Mapping[str, tuple[Predict, str]]] = {
    "kf": (predict_linear, "fixed"),
    "ekf": (predict_extended, "fixed"),
    "ukf": (predict_unscented, "fixed"),
    **{rule: (predict_unscented, rule) for rule in NOISE_RULES if rule != "fixed"},
}
"""Name -> prediction, rule for R. A rule of `noise/rules.py` is at once a filter of its name, behind the UKF."""


AS_PRINTED: Final = frozenset({"fuzzy-thesis"})
"""Filters that take every sensor for what its channel says, as their source does."""


def build_filter(
    name: str, facts: FilterFacts, *, observer: Observer | None = None, judge: Judge | None = None
) -> Filter:
    """A filter of the registry.

    Raises: WayfixError for an unknown name.
    """
    if name not in REGISTRY:
        raise WayfixError(f"unknown filter {name!r}", "--filters", f"use one or more of {', '.join(REGISTRY)}")
    predict, rule = REGISTRY[name]
    facts = facts.plain if name in AS_PRINTED else facts
    return Filter(name, predict, NOISE_RULES[rule], facts, observer=observer, judge=judge)
