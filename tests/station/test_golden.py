"""Every golden case replays as expected (tests/golden), and a filter that is changed by one per cent is noticed."""

import argparse
import json
import os
import shutil
from importlib import import_module
from pathlib import Path

import pytest

from common.codec import decode_frame
from common.command import run_command
from shore.logbook.arithmetic import arithmetic_here
from shore.logbook.log_reader import read_log
from shore.navigation.noise.fuzzy import FUZZY
from shore.replay.run import Replay
from shore.trips.golden_case import (
    CASE,
    COLUMNS,
    DECIMALS,
    EVENTS,
    EXPECTED,
    LOG,
    LOG_LIMIT,
    add_arguments,
    differences,
    read_case,
    run,
    write_expected,
)
from tests.golden.make_logs import CASES, HERE, write_log

TOGETHER = 700_000


@pytest.mark.parametrize("name", sorted(path.parent.name for path in HERE.glob(f"*/{LOG}")))
def test_it_replays_as_expected(name: str) -> None:
    case = read_case(HERE / name)
    found = differences(case)
    print(f"{name}: it {case.other_arithmetic}" if case.other_arithmetic else f"{name}: every bit is compared")
    assert not found, "\n".join(found[:20])


def test_the_cases_are_small_and_none_of_the_scripts_is_missing() -> None:
    logs = {path.parent.name: path.stat().st_size for path in HERE.glob(f"*/{LOG}")}
    assert set(logs) >= set(CASES)  # a voyage of anybody's may stand beside them
    assert max(logs.values()) <= LOG_LIMIT
    assert sum(logs.values()) <= TOGETHER


def test_the_script_still_makes_the_same_frames(tmp_path: Path) -> None:
    write_log(tmp_path / LOG, CASES["restarts"])
    assert list(read_log(tmp_path / LOG).frames()) == list(read_log(HERE / "restarts" / LOG).frames())


def test_no_sensor_of_these_boats_is_blamed() -> None:
    """Their sensors are healthy: noise may grow sevenfold at once, or be 20 deg from the start."""
    said = {path.parent.name: path.read_text() for path in HERE.glob(f"*/{EVENTS}")}
    assert len(said) > 10
    assert [name for name, text in said.items() if "set-aside" in text] == []


@pytest.mark.parametrize(
    ("name", "constant", "factor"),
    [
        ("turns", "shore.navigation.initial_state.KNOWN_SPEED_M_S", 0.99),
        ("without-compass", "shore.navigation.trust.water.COURSE_DOUBT_RAD", 0.99),
        ("late-and-shuffled", "shore.navigation.timeline.HORIZON_NS", 0.5),
    ],
)
def test_a_constant_that_is_changed_is_noticed(
    name: str, constant: str, factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, attribute = constant.rsplit(".", 1)
    monkeypatch.setattr(constant, factor * getattr(import_module(module), attribute))
    found = differences(read_case(HERE / name))
    assert len(found) > 10
    assert f"{EXPECTED}, line " in found[0]


def test_one_per_cent_of_the_fuzzy_rules_memory_is_noticed() -> None:
    before = FUZZY.long
    object.__setattr__(FUZZY, "long", 1.01 * before)
    try:
        assert len(differences(read_case(HERE / "noise-step"))) > 10
    finally:
        object.__setattr__(FUZZY, "long", before)


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """A case whose expectation was written in the arithmetic of this test."""
    directory = Path(shutil.copytree(HERE / "without-imu", tmp_path / "case"))
    if read_case(directory).other_arithmetic:
        write_expected(read_case(directory))
    return directory


def elsewhere(case: Path) -> None:
    """The expectation comes from another arithmetic."""
    text = (case / CASE).read_text()
    (case / CASE).write_text(text.replace(f'kernel = "{arithmetic_here()["kernel"]}"', 'kernel = "another"'))


def edited(case: Path, line: int, column: str, units: int) -> list[str]:
    """Differences after one number of the expectation was moved by so many units of its last digit."""
    path = case / EXPECTED
    rows = [row.split(",") for row in path.read_text().splitlines()]
    place = rows[0].index(column)
    rows[line][place] = f"{float(rows[line][place]) + units * 10.0**-DECIMALS:.{DECIMALS}f}"
    path.write_text("".join(",".join(row) + "\n" for row in rows))
    return differences(read_case(case))


@pytest.mark.parametrize("column", COLUMNS)
def test_every_digit_counts_and_elsewhere_the_last_one_may_be_the_next(column: str, case: Path) -> None:
    (found,) = edited(case, 7, column, 1)
    assert found.startswith(f"{EXPECTED}, line 8, {column}: ")
    elsewhere(case)
    assert edited(case, 7, column, 0) == []
    (found,) = edited(case, 7, column, 1)
    assert found.startswith(f"{EXPECTED}, line 8, {column}: ")


def test_the_digest_counts_where_the_arithmetic_is_the_same(case: Path) -> None:
    """It is over every bit, of the covariance too."""
    text = (case / EXPECTED).read_text()
    last = text.rstrip().rsplit(",", 1)[1]
    (case / EXPECTED).write_text(text.replace(last, "0" * 16))
    assert read_case(case).other_arithmetic is None
    (found,) = differences(read_case(case))
    assert found.endswith(f"digest: {last}, expected {'0' * 16}")
    elsewhere(case)
    said = read_case(case).other_arithmetic
    assert said == f"was made with another arithmetic, BLAS kernel another (here {arithmetic_here()['kernel']})"
    assert differences(read_case(case)) == []


def test_rows_and_events_that_are_missing_are_told(case: Path) -> None:
    lines = (case / EXPECTED).read_text().splitlines(keepends=True)
    (case / EXPECTED).write_text("".join(lines[:-2]))
    (case / EVENTS).write_text((case / EVENTS).read_text().replace("filter-aligned", "filter-reset"))
    found = differences(read_case(case))
    assert found == [
        f"{EXPECTED}: {len(lines) - 1} rows, {len(lines) - 3} expected",
        f"{EVENTS}, line 3, code: filter-aligned, expected filter-reset",
    ]
    write_expected(read_case(case))
    assert differences(read_case(case)) == []
    assert (case / EXPECTED).read_text() == "".join(lines)


def command(*asked: str | Path) -> int:
    """`wayfix log case ...`."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    arguments = parser.parse_args([str(each) for each in asked])
    return run_command("wayfix", "shore", lambda: run(arguments))


def test_any_log_becomes_a_case_cut_to_its_span(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, target = HERE / "restarts" / LOG, tmp_path / "cut"
    asked = (source, target, "--from", "20", "--to", "60", "--filters", "kf", "--json")
    assert command(*asked) == 0
    said = capsys.readouterr().out.splitlines()
    sizes = json.loads(said[-1])["bytes"]
    assert said[0].startswith(f"{target}: {LOG} {sizes[LOG]} bytes, {EXPECTED} ")
    case = read_case(target)
    assert (case.name, case.filters, case.order) == ("cut", ("kf",), "arrival")
    assert case.made_by == "wayfix log case log.mcap cut --from 20 --to 60 --filters kf"
    assert differences(case) == []
    frames = [decode_frame(data) for data in read_log(target / LOG).frames()]
    replay = Replay(target / LOG)
    assert replay.filters == ("kf",)
    assert [step.frame for step in replay] == frames
    assert frames[0].t1_ns / 1e9 == pytest.approx(1020.0)
    assert frames[-1].t1_ns / 1e9 == pytest.approx(1060.0)
    assert 0 < sizes[LOG] < source.stat().st_size

    before = {path.name: path.read_bytes() for path in target.iterdir()}
    assert command(*asked) == 2
    assert "never overwritten" in capsys.readouterr().err
    assert before == {path.name: path.read_bytes() for path in target.iterdir()}


def test_words_that_are_no_text_make_no_case(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for option in ("--text", "--name"):
        assert command(HERE / "moored" / LOG, tmp_path / "case", option, "caf\udce9") == 2
        assert f"wayfix: {option}: is no UTF-8 text; write it" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
    assert command(HERE / "moored" / LOG, tmp_path / "caf\udce9") == 0
    assert r"caf\udce9: " in capsys.readouterr().out
    case = read_case(tmp_path / "caf\udce9")
    assert (case.name, case.made_by) == (r"caf\udce9", r"wayfix log case log.mcap caf\udce9")


def test_what_a_killed_command_left_blocks_no_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / ".k9.part").mkdir()
    (tmp_path / f".k9.{os.getpid() + 1}.part").mkdir()
    assert command(HERE / "moored" / LOG, tmp_path / "k9") == 0
    capsys.readouterr()
    assert not differences(read_case(tmp_path / "k9"))


def test_a_case_without_frames_leaves_nothing_behind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(HERE / "turns" / LOG, tmp_path / "none", "--from", "900") == 2
    assert "holds no frame there" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_directory_that_is_no_case_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="holds no regression case"):
        read_case(tmp_path)
