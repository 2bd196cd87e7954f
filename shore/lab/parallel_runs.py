"""Monte Carlo campaign: scenarios x methods x runs, spread over processes.

The work is cut into the same chunks whatever the number of workers, and put together in the order of the runs: the
figures (all but times) do not depend on how many workers there are.
"""

import multiprocessing
import signal
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from common.errors import WayfixError
from common.simulation.monte_carlo_runs import Runs, draw_runs
from common.simulation.scenario import Scenario
from shore.lab.batch import Outcome, Profile, Setting, merged, raw_outcome, run_method
from shore.navigation.numbers import Array

CHUNK: Final = 250
"""Number of runs in one array: larger arrays leave the cache, smaller ones wait for Python."""
RAW: Final = "raw"
"""Name of the sensors themselves among the methods."""


@dataclass(frozen=True, slots=True)
class Task:
    """A chunk of runs of one scenario with one method."""

    scenario: Scenario
    method: str
    profile: Profile
    seed: int
    first: int
    count: int


@dataclass(frozen=True, slots=True)
class Result:
    """All runs of one scenario under one profile."""

    setting: Setting
    """The scenario under one profile, with its first run only."""
    runs: int
    seed: int
    asked: tuple[str, ...]
    """Methods that were asked for; the reference of the ratios is run in any case."""
    outcomes: dict[str, Outcome]
    """What each method did, by its name; the sensors themselves are `raw`."""
    bound: Array
    """Posterior Cramer-Rao bound at each step, (k, 3), in the units of `statistics.COMPONENTS`."""

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.setting.scenario.name

    @property
    def reference(self) -> Outcome:
        """What the method did that the others are compared with."""
        return self.outcomes[self.setting.reference]


@dataclass(frozen=True, slots=True)
class Campaign:
    """What is to be run."""

    scenarios: tuple[Scenario, ...]
    filters: tuple[str, ...]
    runs: int
    seed: int
    profile: Profile

    def tasks(self) -> list[Task]:
        """All tasks in the order of scenarios, runs, methods: what a worker drew serves one method after another."""
        return [
            Task(scenario, method, self.profile, self.seed, first, min(CHUNK, self.runs - first))
            for scenario in self.scenarios
            for first in range(0, self.runs, CHUNK)
            for method in self._methods(scenario)
        ]

    def results(self, outcomes: dict[Task, Outcome]) -> list[Result]:
        """The chunks put together, one result for each scenario."""
        tasks = self.tasks()
        results = []
        for scenario in self.scenarios:
            setting = _first_run(scenario, self.seed, self.profile)
            own = [task for task in tasks if task.scenario == scenario]
            by_method = {
                method: merged([outcomes[task] for task in own if task.method == method])
                for method in self._methods(scenario)
            }
            results.append(Result(setting, self.runs, self.seed, self.filters, by_method, setting.bound))
        return results

    def _methods(self, scenario: Scenario) -> tuple[str, ...]:
        reference = _first_run(scenario, self.seed, self.profile).reference
        return tuple(dict.fromkeys((RAW, *self.filters, reference)))


def _first_run(scenario: Scenario, seed: int, profile: Profile) -> Setting:
    return Setting(scenario, _draw_first(scenario, seed), profile)


@lru_cache(maxsize=32)
def _draw_first(scenario: Scenario, seed: int) -> Runs:
    return draw_runs(scenario, 1, seed)


@lru_cache(maxsize=1)
def _draw(scenario: Scenario, count: int, seed: int, first: int) -> Runs:
    return draw_runs(scenario, count, seed, first)


def work(task: Task) -> Outcome:
    """Do one task; runs in a worker."""
    runs = _draw(task.scenario, task.count, task.seed, task.first)
    setting = Setting(task.scenario, runs, task.profile)
    if task.method == RAW:
        return raw_outcome(setting, first=task.first == 0)
    return run_method(task.method, setting, first=task.first == 0)


def run_tasks(tasks: Sequence[Task], workers: int, done: Callable[[], None]) -> dict[Task, Outcome]:
    """Outcomes of all tasks; `done` is called after each. One worker is this process itself."""
    if workers == 1:
        return dict(_one_by_one(tasks, done))
    executor = ProcessPoolExecutor(min(workers, len(tasks)), multiprocessing.get_context("spawn"))
    try:
        futures = _submit(executor, tasks)
        for _ in as_completed(futures):
            done()
        return {task: future.result() for future, task in futures.items()}
    except BrokenExecutor as error:
        cure = "it may lack memory or rights: use --workers 1"
        raise WayfixError("a worker died or could not be started", cure=cure) from error
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        for child in multiprocessing.active_children():
            child.terminate()
        raise
    finally:
        executor.shutdown()


def _one_by_one(tasks: Iterable[Task], done: Callable[[], None]) -> Iterable[tuple[Task, Outcome]]:
    for task in tasks:
        yield task, work(task)
        done()


def _submit(executor: ProcessPoolExecutor, tasks: Iterable[Task]) -> dict[Future[Outcome], Task]:
    """Start the workers deaf to Ctrl-C: it is this process that ends them, without a word from any of them."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        return {executor.submit(work, task): task for task in tasks}
    finally:
        signal.signal(signal.SIGINT, before)
