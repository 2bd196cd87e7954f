"""`wayfix lab`: the JSON line, workers, scores against the theory, and wrong input."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from common.simulation.scenarios import find_scenario
from shore.lab.arguments import DEFAULT_FILTERS
from shore.lab.batch import Outcome, Setting, raw_outcome
from shore.lab.figures import Picture
from shore.lab.methods import METHODS
from shore.lab.parallel_runs import Campaign, Result, run_tasks
from shore.lab.scores import as_json, bound_of, comparisons, score
from shore.lab.statistics import COMPONENTS
from shore.lab.tables import LEAST_WIDTH, tables_of
from shore.lab.thesis_checks import CHAPTER_4, CHAPTER_5
from shore.lab.thesis_published import PUBLISHED
from shore.main import main


def run(names: list[str], filters: list[str], runs: int, workers: int = 1, seed: int = 1) -> list[Result]:
    campaign = Campaign(tuple(map(find_scenario, names)), tuple(filters), runs, seed, "stated")
    return campaign.results(run_tasks(campaign.tasks(), workers, lambda: None))


def without_times(results: list[Result]) -> str:
    return re.sub(r'"us_per_step": [0-9.e+]+', "", json.dumps([as_json(result) for result in results]))


def test_the_figures_do_not_depend_on_the_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shore.lab.parallel_runs.CHUNK", 3)
    alone = run(["4.2"], ["fuzzy", "kf"], 8)
    together = run(["4.2"], ["fuzzy", "kf"], 8, workers=2)
    assert without_times(alone) == without_times(together)
    for one, two in zip(alone, together, strict=True):
        for method, outcome in one.outcomes.items():
            assert np.array_equal(outcome.squares, two.outcomes[method].squares)
            assert np.array_equal(outcome.nees, two.outcomes[method].nees, equal_nan=True)
    monkeypatch.setattr("shore.lab.parallel_runs.CHUNK", 250)
    assert as_json(run(["4.2"], ["kf"], 8)[0])["results"]["kf"]["mse"] == as_json(alone[0])["results"]["kf"]["mse"]


def test_the_json_line_has_the_agreed_shape(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["lab", "run", "4.2", "4.0", "--filters", "kf,static", "--runs", "4", "--seed", "5", "--workers", "1"]
    assert main([*arguments, "--json"]) == 0
    said = capsys.readouterr()
    lines = said.out.splitlines()
    assert "Table 4.3 beside our runs" in said.err
    first, second = map(json.loads, lines)
    assert list(first) == ["scenario", "runs", "seed", "profile", "reference", "results", "bound", "published"]
    assert (first["scenario"], first["runs"], first["seed"], first["profile"]) == ("4.2", 4, 5, "stated")
    assert list(first["results"]) == ["kf", "static"]
    one: dict[str, Any] = first["results"]["kf"]
    assert list(one) == ["mse", "ci95", "ratio_to_oracle", "anees", "anis", "us_per_step"]
    for name in ("mse", "ci95", "ratio_to_oracle"):
        assert tuple(one[name]) == COMPONENTS
    assert tuple(first["bound"]) == COMPONENTS
    for component in COMPONENTS:
        low, high = one["ci95"][component]
        assert low < one["mse"][component] < high
    assert first["published"]["kf"] == {"east_m2": 1.5635, "north_m2": 0.8454, "heading_deg2": 0.1365}
    assert second["published"] == {}
    assert (first["reference"], second["reference"]) == ("oracle", "static")
    assert second["results"]["static"]["ratio_to_oracle"] == dict.fromkeys(COMPONENTS, 1.0)


def test_dead_reckoning_has_no_innovations_and_says_null() -> None:
    (result,) = run(["4.2"], ["dead-reckoning"], 3)
    assert as_json(result)["results"]["dead-reckoning"]["anis"] is None
    json.dumps(as_json(result), allow_nan=False)


def test_every_published_row_names_a_scenario_and_a_method() -> None:
    assert tuple(PUBLISHED) == (*CHAPTER_4, *CHAPTER_5)
    for name, printed in PUBLISHED.items():
        find_scenario(name)
        assert set(printed.rows) - {"raw"} <= set(METHODS)
    assert set(DEFAULT_FILTERS.split(",")) <= set(METHODS)


@pytest.mark.slow
def test_raw_rows_of_the_practical_scenarios_are_within_the_spread_of_one_run() -> None:
    for name in ("4.2", "4.3-0.5", "4.4-T1"):
        (result,) = run([name], ["kf"], 60)
        raw = next(row for row in comparisons(result) if row.method == "raw")
        assert max(map(abs, raw.z)) < 2.6, name
        assert score(result, "raw").mse[2].value == pytest.approx(0.25 if name == "4.2" else 1.0, rel=0.03)


@pytest.mark.slow
def test_the_oracle_meets_the_bound_and_its_own_doubt() -> None:
    for result in run(["4.2", "4.3-0.5", "5.1", "5.2", "5.3"], ["oracle"], 200):
        scored = score(result, "oracle")
        assert all(0.9 < each < 1.1 for each in scored.to_bound), result.name
        assert 4.7 < scored.anees < 5.3
        assert 2.9 < scored.anis < 3.1


@pytest.mark.slow
def test_a_moored_boat_reaches_eqs_4_5_and_4_8() -> None:
    (result,) = run(["4.0"], ["static"], 1000)
    mse = score(result, "static").mse
    assert [each.value / least for each, least in zip(mse[:2], bound_of(result)[:2], strict=True)] == pytest.approx(
        [1.0, 1.0], abs=0.05
    )


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["lab", "run", "9.9"], "wayfix lab run: there is no scenario '9.9'; choose one of: 4.0, 4.1"),
        (["lab", "run", "5.1", "--filters", "kalmann"], "--filters: unknown filter 'kalmann'; use one or more of kf"),
        (["lab", "run", "5.1", "--filters", ""], "--filters: unknown filter ''; use one or more of kf"),
        (["lab", "run", "agile", "--profile", "compat"], "agile: nothing is published about it"),
        (["lab", "thesis", "--out", "/dev/null/x"], "/dev/null/x: cannot be used"),
        (["lab", "run", "5.1", "--plots", "/proc"], "/proc: cannot be used"),
    ],
)
def test_wrong_input_is_one_sentence(arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert sentence in said


@pytest.mark.parametrize("option", [["run", "5.1", "--plots"], ["thesis", "--out"]])
def test_an_empty_name_is_no_directory(option: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["lab", *option, ""])
    assert stop.value.code == 2
    assert "must be a directory, got an empty name" in capsys.readouterr().err


def words_of(result: Result) -> str:
    console = Console(width=LEAST_WIDTH)
    with console.capture() as capture:
        for part in tables_of(result):
            console.print(part)
    return " ".join(capture.get().split())


def test_tables_say_what_a_published_row_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shore.lab.parallel_runs.run_method", sensors_in_place_of_a_filter)
    few, enough = (words_of(*run(["5.3"], ["ukf"], runs)) for runs in (9, 10))
    for words in (few, enough):
        assert "raw sensors (after the change)" in words
        assert "z of the raw rows is taken after the change" in words
    assert "z needs 10 runs" in few
    assert "on the logarithm" in enough


def test_no_bound_for_a_method_that_is_told_the_biases(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shore.lab.parallel_runs.run_method", sensors_in_place_of_a_filter)
    (biased,), (free,) = (run([name], ["ukf", "oracle"], 2) for name in ("uncalibrated", "5.1"))
    assert np.all(np.isnan(score(biased, "oracle").to_bound))
    assert np.all(np.isfinite([*score(biased, "ukf").to_bound, *score(free, "oracle").to_bound]))
    assert "has to find the biases" in words_of(biased)
    assert "has to find the biases" not in words_of(free)


@pytest.mark.skipif(os.name != "posix", reason="a shell of POSIX")
@pytest.mark.parametrize(
    ("rest", "seen"), [(">&-", ""), ("2>&-", "Scenarios: "), ("| head -1", "Scenarios: "), ("| true", "")]
)
def test_nobody_reads_and_all_is_well(rest: str, seen: str) -> None:
    """A closed stdout or stderr, and a pipe whose reader is gone before anything is written."""
    command = f"set -o pipefail; {shlex.quote(sys.executable)} -m shore.main lab list {rest}"
    bash = shutil.which("bash") or pytest.skip("needs bash")
    done = subprocess.run([bash, "-c", command], capture_output=True, text=True, timeout=30, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(seen)
    assert bool(done.stdout) == bool(seen)


@pytest.mark.parametrize("runs", ["1", "0", "x", "200000"])
def test_too_few_runs_are_refused(runs: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["lab", "run", "5.1", "--runs", runs])
    assert stop.value.code == 2
    assert "must be a whole number from 2 to 10000" in capsys.readouterr().err


def test_without_matplotlib_one_sentence_before_the_work(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setattr("shore.lab.command.run_campaigns", lambda *_: pytest.fail("the work began"))
    assert main(["lab", "run", "5.1", "--plots", str(tmp_path)]) == 2
    assert capsys.readouterr().err.strip().endswith("-m pip install '.[report]', in the directory of Wayfix")


def sensors_in_place_of_a_filter(name: str, setting: Setting, *, first: bool) -> Outcome:
    del name
    raw = raw_outcome(setting, first=first)
    runs = len(raw.nees)
    return replace(raw, nees=np.full(runs, 5.0), nis=np.full(runs, 3.0), seconds=0.1, live_us=90.0)


def test_the_page_of_the_thesis_holds_everything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Filters and pictures have their own tests."""
    monkeypatch.setattr("shore.lab.parallel_runs.run_method", sensors_in_place_of_a_filter)
    monkeypatch.setattr("shore.lab.thesis.pictures", lambda *_: iter([Picture("tracks", "a caption", b"png")]))
    assert main(["lab", "thesis", "--out", str(tmp_path), "--runs", "2", "--workers", "1"]) == 0
    page = (tmp_path / "thesis.html").read_text(encoding="utf-8")
    for name in ("4.0", *CHAPTER_4, *CHAPTER_5, "roadford"):
        assert page.count(f'<h3 id="{name}">') == 1
    for printed in PUBLISHED.values():
        assert f"Table {printed.table} beside our runs" in page
    assert "http" not in page
    assert "<script" not in page
    assert re.search(r"\bnan\b", page) is None
    assert page.count('src="data:image/png;base64,') == 13
    data = json.loads((tmp_path / "thesis.json").read_text(encoding="utf-8"))
    assert {(one["scenario"], one["profile"]) for one in data["scenarios"]} >= {
        (name, profile) for name in (*CHAPTER_4, *CHAPTER_5) for profile in ("stated", "compat")
    }
    assert all(check["what"] and isinstance(check["is_met"], bool) for check in data["checks"])


def test_pictures_are_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    arguments = ["lab", "run", "4.2", "--filters", "ukf,fuzzy", "--runs", "2", "--workers", "1"]
    assert main([*arguments, "--plots", str(tmp_path)]) == 0
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == [f"4.2-stated-{kind}.png" for kind in ("headings", "noise", "rms", "tracks")]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in tmp_path.iterdir())
    assert "picture" in capsys.readouterr().out
