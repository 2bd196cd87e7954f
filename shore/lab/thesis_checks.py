"""Claims of chapters 4 and 5 (acceptance checks): what should hold, and whether it does in these runs."""

from collections.abc import Callable, Iterable, Mapping
from typing import Final, NamedTuple

from shore.lab.methods import ORACLE
from shore.lab.parallel_runs import Result
from shore.lab.scores import LEAST_RUNS_FOR_Z, ODD, comparisons, score
from shore.navigation.filter_registry import REGISTRY

THESIS: Final = "fuzzy-thesis"
CHAPTER_4: Final = ("4.1", "4.2", "4.3-0.5", "4.3-0.3", "4.3-0.15", "4.4-T1", "4.4-T2", "4.4-T3")
PRACTICAL: Final = CHAPTER_4[2:]
CHAPTER_5: Final = ("5.1", "5.2", "5.3")
POSITION, HEADING, ALL = (0, 1), (2,), (0, 1, 2)

Results = Mapping[tuple[str, str], Result]
"""All runs of a scenario under a profile, by (scenario, profile)."""


class Check(NamedTuple):
    """One claim of the thesis or of ours, and whether these runs bear it out."""

    what: str
    ask: str
    found: str
    is_met: bool


def checks(results: Results) -> list[Check]:
    """All claims about the scenarios that were run."""
    return [*_oracle(results), *_filters(results), *_compat(results)]


def _oracle(results: Results) -> Iterable[Check]:
    moving = [results[name, "stated"] for name in (*CHAPTER_4, *CHAPTER_5)]
    scores = [score(result, ORACLE) for result in moving]
    yield _range("oracle / bound, all scenarios and components", [r for s in scores for r in s.to_bound], 0.90, 1.10)
    yield _range("oracle: ANEES", [each.anees for each in scores], 4.7, 5.3)
    yield _range("oracle: ANIS", [each.anis for each in scores], 2.9, 3.1)
    static = score(results["4.0", "stated"], "static")
    yield _range("4.0: error variance of the position / Eqs 4.5, 4.8", list(static.to_bound[:2]), 0.95, 1.05)


def _filters(results: Results) -> Iterable[Check]:
    def ratios(method: str, names: Iterable[str], components: tuple[int, ...]) -> list[float]:
        scores = [score(results[name, "stated"], method) for name in names]
        return [each.ratio[component].value for each in scores for component in components]

    yield _range("4.3, 4.4: UKF with Table 4.1's R / oracle", ratios("ukf", PRACTICAL, ALL), 1.1, 1.45)
    for what, method, names, components, most in (
        ("5.1: fuzzy, position / oracle", "fuzzy", ("5.1",), POSITION, 1.05),
        ("5.2: fuzzy, position / oracle", "fuzzy", ("5.2",), POSITION, 1.06),
        ("5.3: fuzzy, position / oracle", "fuzzy", ("5.3",), POSITION, 1.08),
        ("5.1: fuzzy, heading / oracle", "fuzzy", ("5.1",), HEADING, 1.05),
        ("5.2, 5.3: fuzzy, heading / oracle", "fuzzy", ("5.2", "5.3"), HEADING, 1.08),
        ("5.1: literal rule / oracle", THESIS, ("5.1",), ALL, 1.08),
        ("5.3: literal rule / oracle", THESIS, ("5.3",), ALL, 1.15),
        ("5.2: literal rule, position / oracle", THESIS, ("5.2",), POSITION, 1.6),
        ("5.2: literal rule, heading / oracle", THESIS, ("5.2",), HEADING, 2.8),
    ):
        yield _most(what, ratios(method, names, components), most)
    yield _best(ratios)
    fixed = [
        score(results[name, "stated"], "ukf").mse[2].value / score(results[name, "stated"], "fuzzy").mse[2].value
        for name in ("5.2", "5.3")
    ]
    yield Check("5.2, 5.3: fixed UKF / fuzzy, heading", "≥ 3.5", _shown(fixed), min(fixed) >= 3.5)
    anees = [score(results[name, "stated"], "fuzzy").anees for name in CHAPTER_5]
    yield _range("5.1-5.3: fuzzy ANEES", anees, 4.5, 6.0)


def _best(ratios: Callable[[str, Iterable[str], tuple[int, ...]], list[float]]) -> Check:
    """The method whose worst ratio over 5.1-5.3 is least."""
    worst = {name: max(ratios(name, CHAPTER_5, ALL)) for name in REGISTRY}
    best = min(worst, key=lambda name: worst[name])
    return Check(
        "5.1-5.3: best method, worst of all ratios", "≤ 1.08", f"{best}: {worst[best]:.3f}", worst[best] <= 1.08
    )


def _compat(results: Results) -> Iterable[Check]:
    def count(names: Iterable[str], method: str) -> tuple[int, int]:
        z = [
            each
            for name in names
            for row in comparisons(results[name, "compat"])
            if row.method == method
            for each in row.z
        ]
        return sum(abs(each) < ODD for each in z), len(z)

    for what, names, method, least in (
        ("4.3, 4.4: published UKF within 2 sd of one run, compat", PRACTICAL, "ukf", 15),
        ("5.2, 5.3: published adaptive UKF within 2 sd of one run, compat", ("5.2", "5.3"), THESIS, 5),
    ):
        within, total = count(names, method)
        known = all(results[name, "compat"].runs >= LEAST_RUNS_FOR_Z for name in names)
        found = f"{within} of {total}" if known else f"needs {LEAST_RUNS_FOR_Z} runs"
        yield Check(what, f"≥ {least} of {total}", found, within >= least)


def _range(what: str, values: list[float], low: float, high: float) -> Check:
    return Check(what, f"{low:g} to {high:g}", _shown(values), low <= min(values) and max(values) <= high)


def _most(what: str, values: list[float], most: float) -> Check:
    return Check(what, f"≤ {most:g}", _shown(values), max(values) <= most)


def _shown(values: list[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:.3f}" if len(values) == 1 else f"{low:.3f} to {high:.3f}"
