"""Terminal tables of `lab list` and `lab run`."""

import math
from collections.abc import Iterable

from rich.console import Console, RenderableType
from rich.table import Table

from common.simulation.scenarios import WORLDS
from common.words import counted
from shore.lab.methods import METHODS
from shore.lab.parallel_runs import RAW, Result
from shore.lab.scores import LEAST_RUNS_FOR_Z, WHOLE, bound_of, comparisons, score
from shore.lab.statistics import IntervalEstimate
from shore.lab.thesis_published import PUBLISHED, RAW_AFTER_CHANGE

LEAST_WIDTH = 170
"""Width in characters where the output is no terminal."""


class _Terminal(Console):
    """rich would end the program itself, with exit code 1, when who reads has had enough (`| head`)."""

    def on_broken_pipe(self) -> None:
        """Leave it to `run_command`."""
        raise BrokenPipeError


def console(*, stderr: bool = False) -> Console:
    """Stdout or stderr; wide enough for the tables when it goes to a file or a pipe."""
    plain = _Terminal(highlight=False, stderr=stderr)
    return plain if plain.is_terminal else _Terminal(highlight=False, stderr=stderr, width=LEAST_WIDTH)


def lists() -> Iterable[RenderableType]:
    """The scenarios by group, then the methods."""
    for group in dict.fromkeys(scenario.group for scenario in WORLDS.values()):
        table = Table(title=f"Scenarios: {group}", title_justify="left", box=None, pad_edge=False)
        for heading in ("name", "published", "what"):
            table.add_column(heading, no_wrap=heading != "what")
        for name, scenario in WORLDS.items():
            if scenario.group == group:
                printed = f"Table {PUBLISHED[name].table}" if name in PUBLISHED else ""
                table.add_row(name, printed, scenario.text)
        yield table
    table = Table(title="Filters", title_justify="left", box=None, pad_edge=False)
    table.add_column("name", no_wrap=True)
    table.add_column("what")
    for name, method in METHODS.items():
        table.add_row(name, method.text)
    yield table


def tables_of(result: Result) -> Iterable[RenderableType]:
    """Everything about one result."""
    scenario = result.setting.scenario
    steps = len(result.bound) - 1
    yield (
        f"[bold]{scenario.name}[/bold]: {scenario.text}\n"
        f"{steps} steps of {result.setting.runs.step_s:g} s, {counted(result.runs, 'run')}, seed {result.seed}, "
        f"profile {result.setting.profile}; MSE with 95 % interval, in brackets the sd of one run"
    )
    yield from _main_tables(result)
    yield from bound_remarks(result)
    yield from _comparison_table(result)
    yield from _span_table(result)


def _main_tables(result: Result) -> Iterable[Table]:
    """Errors, what they mean, and what they cost: one table of all is wider than a terminal of 80 columns."""
    errors = _table("filter", "east, m²", "north, m²", "heading, deg²")
    meanings = _table("filter", f"x {result.setting.reference}", "x bound", "ANEES", "ANIS")
    costs = _table("filter", "µs a run-step", "live µs")
    for method in (RAW, *result.asked):
        scored = score(result, method)
        cells = [_mse_cell(mean, sd) for mean, sd in zip(scored.mse, scored.sd, strict=True)]
        errors.add_row("raw sensors" if method == RAW else method, *cells)
        if method == RAW:
            continue
        ratios = " ".join(f"{each.value:.3f}" for each in scored.ratio)
        to_bound = " ".join(plain(each, ".3f") for each in scored.to_bound)
        meanings.add_row(method, ratios, to_bound, f"{scored.anees:.2f}", plain(scored.anis, ".2f"))
        costs.add_row(method, f"{scored.us_per_step:.1f}", f"{scored.live_us:.0f}")
    errors.add_row("bound", *(f"{least:.3g}" for least in bound_of(result)))
    yield errors
    yield meanings
    yield costs


def _table(first: str, *headings: str) -> Table:
    """An empty table: words in the first column, numbers in the others."""
    table = Table(box=None, pad_edge=False)
    table.add_column(first)
    for heading in headings:
        table.add_column(heading, justify="right")
    return table


def _comparison_table(result: Result) -> Iterable[RenderableType]:
    found = comparisons(result)
    if not found:
        return
    printed = PUBLISHED[result.name]
    table = Table(title=f"Table {printed.table} beside our runs", title_justify="left", box=None, pad_edge=False)
    for heading in ("published", "east, m²", "north, m²", "hdg, deg²", "z of each"):
        table.add_column(heading, justify="left" if heading == "published" else "right", no_wrap=True)
    for row in found:
        name = row_name(result, row.method)
        table.add_row(name, *(f"{each:.4g}" for each in row.published), " ".join(plain(each, "+.1f") for each in row.z))
    yield table
    if result.runs < LEAST_RUNS_FOR_Z:
        yield f"z needs {LEAST_RUNS_FOR_Z} runs."
    else:
        yield "z: standard deviations from our mean, on the logarithm of the MSE, among single runs."
    if printed.remark:
        yield printed.remark


def row_name(result: Result, method: str) -> str:
    """What a row of a published table is called, and of which steps it is."""
    name = "raw sensors" if method == RAW else method
    return f"{name} (after the change)" if method == RAW and result.name in RAW_AFTER_CHANGE else name


def bound_remarks(result: Result) -> Iterable[str]:
    """What is not obvious of the column "x bound"."""
    if result.setting.biased and any(METHODS[method].knows_bias for method in result.asked):
        yield "The bound is that of a filter that has to find the biases: none for a method that is told them."
    if result.setting.told.exact_start:
        yield "The bound is for a start drawn from P(1); errors after the exact start of compat may lie below it."


def _span_table(result: Result) -> Iterable[Table]:
    """Before a change, just after it, later: an overall MSE would mix them."""
    parts = [span for span in result.setting.spans if span != WHOLE]
    if not parts:
        return
    table = _table("filter", "part", "steps", "MSE", f"x {result.setting.reference}")
    table.title, table.title_justify = "Parts of the run", "left"
    for method in result.asked:
        for span in parts:
            scored, rows = score(result, method, span), result.setting.spans[span]
            mse = " ".join(f"{each.value:.3g}" for each in scored.mse)
            ratios = " ".join(f"{each.value:.2f}" for each in scored.ratio)
            table.add_row(method, span, f"{rows.start}-{rows.stop - 1}", mse, ratios)
    yield table


def _mse_cell(mean: IntervalEstimate, sd: float) -> str:
    return f"{plain(mean.value, '.3g')} ±{plain(half_width(mean), '.2g')} ({plain(sd, '.2g')})"


def half_width(estimate: IntervalEstimate) -> float:
    """Half width of the interval."""
    return 0.5 * (estimate.interval.high - estimate.interval.low)


def plain(value: float, form: str) -> str:
    """A number as text, without exponents below a million; "-" for one that does not exist."""
    if not math.isfinite(value):
        return "-"
    text = format(value, form)
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e6 else text
