"""What filters must reach on the scenarios of chapters 4 and 5 and on ours: 200 paired runs, ratios of mean MSEs."""

from collections.abc import Sequence

import pytest

from common.simulation.monte_carlo_runs import draw_runs
from common.simulation.scenario import Scenario, with_bias
from common.simulation.scenarios import find_scenario
from shore.lab.batch import Outcome, Profile, Setting, merged
from shore.lab.parallel_runs import Campaign, Result, Task, work
from shore.lab.scores import WHOLE, score
from shore.lab.thesis import campaigns
from shore.lab.thesis_checks import checks

pytestmark = pytest.mark.slow

RUNS, SEED = 200, 2027


class OnDemand(dict[str, Outcome]):
    """Outcomes of one scenario by method, each run when it is asked for: the page shows more than its checks read."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        super().__init__()
        self._tasks = tasks

    def __contains__(self, method: object) -> bool:
        return any(task.method == method for task in self._tasks)

    def __missing__(self, method: str) -> Outcome:
        self[method] = merged([work(task) for task in self._tasks if task.method == method])
        return self[method]


def results_of(asked: Campaign) -> list[Result]:
    tasks = asked.tasks()
    results = []
    for scenario in asked.scenarios:
        setting = Setting(scenario, draw_runs(scenario, 1, asked.seed), asked.profile)
        outcomes = OnDemand([task for task in tasks if task.scenario == scenario])
        results.append(Result(setting, asked.runs, asked.seed, asked.filters, outcomes, setting.bound))
    return results


def result_of(scenario: str | Scenario, *methods: str, profile: Profile = "stated") -> Result:
    where = find_scenario(scenario) if isinstance(scenario, str) else scenario
    (result,) = results_of(Campaign((where,), methods, RUNS, SEED, profile))
    return result


def mse(result: Result, method: str, span: str = WHOLE) -> list[float]:
    return [each.value for each in score(result, method, span).mse]


def test_every_line_of_the_page_of_the_thesis_holds() -> None:
    """Oracle, fixed, literal and improved filters of 4.0 to 5.3, and the published values under `compat`."""
    results = [result for each in campaigns(RUNS, SEED) for result in results_of(each)]
    by_name = {(each.name, str(each.setting.profile)): each for each in results}
    lines = checks(by_name)
    assert len(lines) >= 19
    for line in lines:
        print(f"  asks: {line.what}: {line.found} ({line.ask})")
    assert [line for line in lines if not line.is_met] == []


def test_a_noisy_imu_needs_a_rule_for_q() -> None:
    result = result_of("imu-noise", "ukf", "fuzzy-qr")
    fixed, ours = (score(result, name).ratio for name in ("ukf", "fuzzy-qr"))
    print("  asks: imu-noise, fixed Q / oracle", [f"{each.value:.2f}" for each in fixed])
    print("  asks: imu-noise, fuzzy-qr / oracle", [f"{each.value:.2f}" for each in ours])
    assert max(each.value for each in ours) <= 1.5
    assert min(each.value for each in fixed) >= 1.8


def test_the_lake_with_worse_sensors_than_told() -> None:
    result = result_of("roadford", "ukf", "fuzzy")
    ratio = mse(result, "ukf")[2] / mse(result, "fuzzy")[2]
    print(f"  asks: roadford, heading, fixed UKF / fuzzy {ratio:.2f}")
    assert ratio >= 3.0


def test_biases_left_in_cost_little_after_half_of_the_run() -> None:
    """Eight states that have to find the biases, against five states whose biases were removed."""
    result = result_of("uncalibrated", "ukf")
    half = [name for name in score_spans(result) if name.startswith("second half")]
    ratio = [each.value for each in score(result, "ukf", half[0]).ratio]
    print("  asks: uncalibrated, second half, 8 states / bias-free", [f"{each:.3f}" for each in ratio])
    assert max(ratio) <= 1.20


def test_full_bias_and_bad_sensors_at_once_do_not_run_away() -> None:
    """The naive pair of bias states and a windowed rule reached 23 deg^2 here."""
    result = result_of(with_bias(find_scenario("5.2")), "fuzzy", "oracle-8")
    east, north, heading = (a / b for a, b in zip(mse(result, "fuzzy"), mse(result, "oracle-8"), strict=True))
    print(f"  asks: full bias and 5.2's noise, fuzzy / 8-state oracle {east:.3f} {north:.3f} {heading:.3f}")
    assert max(east, north) <= 1.06
    assert heading <= 1.20


def score_spans(result: Result) -> list[str]:
    return list(result.setting.spans)
