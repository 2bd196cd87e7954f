"""`wayfix lab thesis`: every table and figure of chapters 4 and 5 on one page, ours beside what is printed."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Final

import numpy as np

from common.simulation.scenario import Scenario
from common.simulation.scenarios import SCENARIOS
from common.words import counted
from shore.lab import html_page as page
from shore.lab.batch import Profile
from shore.lab.figures import pictures
from shore.lab.methods import ORACLE
from shore.lab.parallel_runs import RAW, Campaign, Result
from shore.lab.scores import WHOLE, as_json, bound_of, claimed_sigma, comparisons, score
from shore.lab.tables import bound_remarks, half_width, plain, row_name
from shore.lab.thesis_checks import CHAPTER_4, CHAPTER_5, Results, checks
from shore.lab.thesis_published import PUBLISHED, US_PER_STEP
from shore.lab.thesis_readings import READINGS
from shore.navigation.filter_registry import REGISTRY

COMPARED: Final = (*REGISTRY, ORACLE)
PUBLISHED_FILTERS: Final = ("kf", "ukf", "fuzzy-thesis")
TABLE_2_6: Final = ("kf", "ekf", "ukf", "interval-kf", "ukf-5", "dead-reckoning")
TABLE_2_6_SCENARIOS: Final = ("5.1", "agile", "uncalibrated")
MOORED_RUNS_EACH: Final = 50
"""The errors of a moored boat's run are nearly one: it takes many runs, and its steps are cheap."""
MSE_HEADINGS: Final = ("east, m²", "north, m²", "heading, °²")


def campaigns(runs: int, seed: int) -> list[Campaign]:
    """Everything the page shows."""
    both = dict.fromkeys((*COMPARED, *TABLE_2_6))

    def of(names: Iterable[str], filters: Iterable[str], profile: Profile = "stated") -> Campaign:
        return Campaign(tuple(SCENARIOS[name] for name in names), tuple(filters), runs, seed, profile)

    moored = of(["4.0"], ["static"])
    return [
        replace(moored, runs=MOORED_RUNS_EACH * runs),
        of([*CHAPTER_4, "5.2", "5.3", "roadford"], COMPARED),
        of(["5.1"], both),
        of(TABLE_2_6_SCENARIOS[1:], TABLE_2_6),
        of([*CHAPTER_4, *CHAPTER_5], PUBLISHED_FILTERS, "compat"),
    ]


def write_page(results: list[Result], directory: Path) -> list[Path]:
    """Write `thesis.html` and `thesis.json`; returns their paths."""
    by_name = {(result.name, str(result.setting.profile)): result for result in results}
    shown, data = directory / "thesis.html", directory / "thesis.json"
    shown.write_text(page.document("Wayfix: chapters 4 and 5 again", _body(by_name)), encoding="utf-8")
    content = {
        "scenarios": [as_json(result) for result in results],
        "checks": [check._asdict() for check in checks(by_name)],
    }
    data.write_text(json.dumps(content, allow_nan=False, indent=1) + "\n", encoding="utf-8")
    return [shown, data]


def _body(results: Results) -> Iterator[str]:
    some = results["5.3", "stated"]
    yield "<h1>Chapters 4 and 5 again</h1>"
    yield (
        f'<p class="note">Wayfix {escape(version("wayfix"))}, <code>wayfix lab thesis --runs {some.runs} '
        f"--seed {some.seed}</code>. Everything on this page is simulated.</p>"
    )
    yield (
        "<p>All simulations of W. Liu's thesis, each many times with new noise, the same noise for all filters. "
        "A published number is one run; <b>z</b> says how many standard deviations it lies from ours, on the logarithm "
        "and among single runs: |z| below 2 is within the spread of one run. The <b>oracle</b> is a UKF that is told "
        "the true noise of each step; the <b>bound</b> (posterior Cramér-Rao) is what no filter can beat after a start "
        "drawn from P(1). Profile <b>stated</b> is what the thesis' tables say, with such a start; <b>compat</b> is "
        "what explains most of its figures: Q from q instead of q squared, an exact start, and in 4.3 and 4.4 the "
        "true R.</p>"
    )
    yield _contents()
    yield '<h2 id="checks">What should hold</h2>'
    yield page.table(
        ("what", "asked", "found", "holds"),
        ((escape(c.what), escape(c.ask), escape(c.found), page.verdict(c.is_met)) for c in checks(results)),
    )
    yield '<h2 id="4">Chapter 4: multi-sensor data fusion</h2>'
    for name in ("4.0", *CHAPTER_4):
        yield from _scenario(results, name)
    yield '<h2 id="5">Chapter 5: R learned on the way</h2>'
    for name in (*CHAPTER_5, "roadford"):
        yield from _scenario(results, name)
    yield '<h2 id="2.6">Table 2.6 in numbers</h2>'
    yield from _table_2_6(results)
    yield '<h2 id="readings">Where the text can be read in two ways</h2>'
    yield page.table(("where", "doubt", "our reading"), READINGS, kind="text")


def _contents() -> str:
    links = [("checks", "What should hold")]
    links += [(name, f"{name}: {_short(SCENARIOS[name])}") for name in ("4.0", *CHAPTER_4, *CHAPTER_5, "roadford")]
    links += [("2.6", "Table 2.6 in numbers"), ("readings", "Where the text can be read in two ways")]
    return "<nav>" + "".join(f'<a href="#{target}">{escape(text)}</a>' for target, text in links) + "</nav>"


def _short(scenario: Scenario) -> str:
    return scenario.text.split(";")[0].split(":")[0]


def _scenario(results: Results, name: str) -> Iterator[str]:
    result = results[name, "stated"]
    yield f'<h3 id="{name}">{name}: {escape(result.setting.scenario.text)}</h3>'
    runs = counted(result.runs, "run")
    yield (
        f'<p class="note">{len(result.bound) - 1} steps of {result.setting.runs.step_s:g} s, {runs}, '
        "profile stated. MSE ± half the 95 % interval; ratios of mean MSEs: east, north, heading.</p>"
    )
    yield _main_table(result)
    yield from (f'<p class="note">{escape(remark)}</p>' for remark in bound_remarks(result))
    yield from _parts_table(result)
    yield from _published_table(result, results.get((name, "compat")))
    shown = tuple(method for method in ("static", *_drawn(name)) if method in result.asked)
    for picture in pictures(result, shown):
        yield page.figure(picture.png, picture.caption, f"{picture.kind} of scenario {name}")


def _drawn(name: str) -> tuple[str, ...]:
    """Few lines a picture: what the thesis drew, and ours."""
    return ("kf", "ukf", "fuzzy") if name in CHAPTER_4 else ("ukf", "fuzzy-thesis", "fuzzy")


def _main_table(result: Result) -> str:
    rows = [["raw sensors", *_mse_cells(result, RAW), "", "", "", "", "", ""]]
    for method in result.asked:
        scored = score(result, method)
        rows.append(
            [
                escape(method),
                *_mse_cells(result, method),
                _triple(tuple(each.value for each in scored.ratio), ".2f"),
                _triple(scored.to_bound, ".2f"),
                f"{scored.anees:.2f}",
                plain(scored.anis, ".2f"),
                f"{scored.us_per_step:.1f}",
                f"{scored.live_us:.0f}",
            ]
        )
    rows.append(["bound", *(plain(least, ".3g") for least in bound_of(result)), "", "", "5", "3", "", ""])
    reference = f"x {result.setting.reference}"
    headings = ("filter", *MSE_HEADINGS, reference, "x bound", "ANEES", "ANIS", "µs a run-step", "live µs a step")
    return page.table(headings, rows)


def _mse_cells(result: Result, method: str, span: str = WHOLE) -> list[str]:
    return [
        f"{plain(mean.value, '.3g')} ± {plain(half_width(mean), '.2g')}" for mean in score(result, method, span).mse
    ]


def _triple(values: tuple[float, ...], form: str) -> str:
    return " / ".join(plain(value, form) for value in values)


def _parts_table(result: Result) -> Iterator[str]:
    """Regimes apart: an overall MSE would mix them."""
    parts = [span for span in result.setting.spans if span != WHOLE]
    if not parts:
        return
    rows = []
    for method in result.asked:
        cells = [escape(method)]
        for span in parts:
            scored = score(result, method, span)
            cells.append(_triple(tuple(each.value for each in scored.mse), ".3g"))
            cells.append(_triple(tuple(each.value for each in scored.ratio), ".2f"))
        rows.append(cells)
    headings = ["filter"]
    for span in parts:
        steps = result.setting.spans[span]
        headings += [f"{span}, steps {steps.start}-{steps.stop - 1}: MSE", f"x {result.setting.reference}"]
    yield page.table(headings, rows, "Before the change, the 50 steps after it, and later")


def _published_table(stated: Result, compat: Result | None) -> Iterator[str]:
    if stated.name not in PUBLISHED or compat is None:
        return
    printed = PUBLISHED[stated.name]
    rows = []
    for row in comparisons(stated):
        name = escape(row_name(stated, row.method))
        rows.append([f"<b>{name}</b>, published", *(f"<b>{each:.4g}</b>" for each in row.published)])
        for result in (stated, compat) if row.method != RAW else (stated,):
            z = next(each.z for each in comparisons(result) if each.method == row.method)
            span = "after" if row.method == RAW and "after" in result.setting.spans else WHOLE
            scored = score(result, row.method, span)
            cells = [
                f"{plain(mean.value, '.3g')} (sd {plain(sd, '.2g')}), z {plain(value, '+.1f')}"
                for mean, sd, value in zip(scored.mse, scored.sd, z, strict=True)
            ]
            rows.append([f"{name}, {result.setting.profile if row.method != RAW else 'ours'}", *cells])
    yield page.table(
        ("", *MSE_HEADINGS), rows, f"Table {printed.table} beside our runs: mean, sd of one run, z of the published run"
    )
    if printed.remark:
        yield f'<p class="note">{escape(printed.remark)}</p>'


def _table_2_6(results: Results) -> Iterator[str]:
    yield (
        "<p>The thesis compares Kalman, extended, unscented and interval Kalman filters in words. Here: the error that "
        "was measured (RMS over all steps and runs), the doubt that the method itself states (1-sigma, RMS; for "
        "the interval filter its interval counts as evenly likely), and the time of one step of one boat. The thesis "
        f"quotes {US_PER_STEP['simulation']:.0f} µs in simulation and {US_PER_STEP['trial']:.0f} µs in its trial.</p>"
    )
    for name in TABLE_2_6_SCENARIOS:
        result = results[name, "stated"]
        rows = []
        for method in TABLE_2_6:
            error = np.sqrt([each.value for each in score(result, method).mse])
            doubt = claimed_sigma(result.outcomes[method], result.runs)
            pairs = zip(error.tolist(), doubt.tolist(), strict=True)
            cells = [plain(each, ".3g") for pair in pairs for each in pair]
            rows.append([escape(method), *cells, f"{score(result, method).live_us:.0f}"])
        headings = (
            "method",
            "east error, m",
            "doubt",
            "north error, m",
            "doubt",
            "heading error, °",
            "doubt",
            "µs",
            "",
        )
        yield page.table(headings, rows, f"{name}: {escape(result.setting.scenario.text)}")
    yield (
        '<p class="note">5.1: all filters agree, since 1 m/s and 3 °/s are nearly linear. agile: the linear filter '
        "takes the heading that rotates the acceleration as exact. uncalibrated: the biases of the IMU were left in; "
        "kf, ekf and ukf have states for them, the interval filter has bounds for the gyro's only, and ukf-5 does not "
        "know of them. In 5.1 and agile the biases were removed, so the interval filter's bounds are 0 and it is kf, "
        "digit for digit.</p>"
    )
