"""`wayfix lab`: arguments in, tables, JSON lines, pictures and the page of the thesis out."""

import argparse
import json
import sys
import tempfile
from collections.abc import Iterable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from common.errors import WayfixError
from common.simulation.scenarios import find_scenario
from shore.lab import tables
from shore.lab.methods import check_methods
from shore.lab.parallel_runs import Campaign, Result, run_tasks
from shore.lab.scores import as_json


def run(arguments: argparse.Namespace) -> int:
    """One of the three commands; returns the exit code."""
    commands = {"list": run_list, "run": run_scenarios, "thesis": run_thesis}
    return commands[arguments.lab](arguments)


def run_list(arguments: argparse.Namespace) -> int:
    """List the scenarios and the filters."""
    del arguments
    show(tables.lists())
    return 0


def run_scenarios(arguments: argparse.Namespace) -> int:
    """Run filters over many simulated runs of scenarios; the same noise for all filters of a call."""
    names = tuple(dict.fromkeys(arguments.scenario))
    scenarios = tuple(find_scenario(name, "wayfix lab run") for name in names)
    filters = check_methods(arguments.filters.split(","))
    if arguments.plots is not None:
        from shore.lab.figures import pyplot, save_figures

        pyplot()
        new_directory(arguments.plots)
    campaign = Campaign(scenarios, filters, arguments.runs, arguments.seed, arguments.profile)
    results = run_campaigns([campaign], arguments.workers)
    for place, result in enumerate(results):
        if place:
            _print("", words=arguments.json)
        show(tables.tables_of(result), words=arguments.json)
    if arguments.plots is not None:
        for path in (path for result in results for path in save_figures(result, arguments.plots)):
            _print(f"picture {path}", words=arguments.json)
    if arguments.json:
        for result in results:
            _print(json.dumps(as_json(result), allow_nan=False))
    return 0


def run_thesis(arguments: argparse.Namespace) -> int:
    """Make all tables and figures of chapters 4 and 5 again: one HTML page, and the same as JSON beside it."""
    from shore.lab.figures import pyplot
    from shore.lab.thesis import campaigns, write_page

    pyplot()
    new_directory(arguments.out)
    results = run_campaigns(campaigns(arguments.runs, arguments.seed), arguments.workers)
    for path in write_page(results, arguments.out):
        _print(f"written {path}")
    return 0


def run_campaigns(campaigns: Iterable[Campaign], workers: int) -> list[Result]:
    """Run them all behind one progress bar on stderr, which only a terminal sees."""
    campaigns = list(campaigns)
    tasks = list(dict.fromkeys(task for campaign in campaigns for task in campaign.tasks()))
    bar = _bar() if sys.stderr and sys.stderr.isatty() else None
    with bar or nullcontext():
        job = bar.add_task("running", total=len(tasks)) if bar else None
        outcomes = run_tasks(tasks, workers, lambda: bar.advance(job) if bar and job is not None else None)
    return [result for campaign in campaigns for result in campaign.results(outcomes)]


def _bar() -> Progress:
    columns: tuple[Any, ...] = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    return Progress(*columns, console=Console(stderr=True))


def new_directory(path: Path) -> None:
    """Make it, and try to write, before the long work begins. Raises WayfixError when it cannot be written."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise WayfixError(f"cannot be used ({error.strerror})", str(path), "give a directory to write into") from error


def show(parts: Iterable[Any], *, words: bool = False) -> None:
    """Print for people: on stdout, or as `words` on stderr, where they do not disturb data."""
    console = tables.console(stderr=words)
    for part in parts:
        console.print(part)


def _print(line: str, *, words: bool = False) -> None:
    print(line, file=sys.stderr if words else sys.stdout, flush=True)
