"""Replay on another floating-point environment: what a log says of its own, and what is still the same answer."""

import json
import math
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from common.messages import Frame
from shore.logbook.arithmetic import WORDS, arithmetic_here, arithmetic_of, unlike
from shore.logbook.estimate_rounding import TOLERANCE, is_near, is_stored_in, logged
from shore.logbook.log_reader import LogRecord, read_log
from shore.main import main
from shore.replay.run import Replay
from tests.station.logs import log_of, rewritten

KERNELS = {"x86_64": ("Nehalem", "Haswell", "SkylakeX"), "aarch64": ("ARMV8", "CORTEXA57", "NEOVERSEN1")}
HERE = arithmetic_here()
Change = Callable[[dict[str, Any]], dict[str, Any]]


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory, voyage: list[Frame]) -> Path:
    """Twelve seconds of a log."""
    return log_of(tmp_path_factory.mktemp("log"), voyage[:120])


def changed(log: Path, path: Path, changes: dict[tuple[str, int], Change]) -> Path:
    """A copy in which single records are changed, by topic and number."""

    def change(record: LogRecord, number: int) -> bytes:
        how = changes.get((record.topic, number))
        return json.dumps(how(record.json()), separators=(",", ":")).encode() if how else record.data

    return rewritten(log, path, change)


def other_numpy(start: dict[str, Any]) -> dict[str, Any]:
    return start | {"versions": start["versions"] | {"numpy": "1.26.4"}}


def unnamed(start: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in start.items() if name != "arithmetic"}


def as_it_was(start: dict[str, Any]) -> dict[str, Any]:
    return start


def said_by(log: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, dict[str, Any]]:
    """Exit code, words and summary of `wayfix replay`."""
    code = main(["replay", str(log), "--json"])
    *words, last = capsys.readouterr().out.splitlines()
    return code, "\n".join(words), json.loads(last)


def elsewhere(log: Path, **environment: str) -> tuple[int, str, dict[str, Any]]:
    """The same in a process with another environment."""
    done = subprocess.run(
        [sys.executable, "-m", "shore.main", "replay", str(log), "--json"],
        env=os.environ | environment, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    *words, last = done.stdout.splitlines()
    return done.returncode, "\n".join(words), json.loads(last)


def test_a_log_names_its_arithmetic_and_info_shows_it(short: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert arithmetic_of(Replay(short).start.record) == HERE
    assert set(HERE) == set(WORDS)
    assert main(["log", "info", str(short)]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert f"BLAS kernel {HERE['kernel']}, CPU features {HERE['cpu']}" in words
    assert main(["log", "info", str(short), "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["arithmetic"]["blas"] == HERE["blas"]


def test_every_name_that_differs_is_said() -> None:
    assert unlike(HERE, HERE) is None
    for name, word in WORDS.items():
        assert unlike(HERE | {name: "x"}, HERE) == f"was made with another arithmetic, {word} x (here {HERE[name]})"


def test_the_same_arithmetic_is_equal_and_nothing_is_said_of_it(
    short: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, words, summary = said_by(short, capsys)
    assert code == 0
    assert "arithmetic" not in words
    assert summary["other_arithmetic"] is None
    assert summary["estimates"]["equal"] == summary["estimates"]["recorded"] == 120


def judge_elsewhere(log: Path, word: str, **environment: str) -> int:
    """Number of estimates that are near, after all that must hold on another arithmetic."""
    code, words, summary = elsewhere(log, **environment)
    assert code == 0, words
    counts = summary["estimates"]
    assert counts["equal"] + counts["near"] == counts["recorded"] == counts["made"]
    assert summary["verdicts"] == []
    if summary["other_arithmetic"] is None:  # OpenBLAS has put one of this processor in the place of such a kernel
        assert counts["near"] == 0
    else:
        assert f"the log was made with another arithmetic, {word} " in words
        assert "compared within 1e-09 (m, m/s, rad, deg;" in words
    return int(counts["near"])


def other_kernels() -> list[str]:
    return [kernel for kernel in KERNELS.get(platform.machine(), ()) if kernel != HERE["kernel"]]


@pytest.mark.skipif(not other_kernels() or HERE["kernel"] == "not known", reason="numpy has no OpenBLAS here")
def test_another_kernel_gives_the_same_answer_within_the_tolerance(short: Path) -> None:
    assert judge_elsewhere(short, "BLAS kernel", OPENBLAS_CORETYPE=other_kernels()[0]) > 100


@pytest.mark.slow
@pytest.mark.skipif(not other_kernels() or HERE["kernel"] == "not known", reason="numpy has no OpenBLAS here")
def test_under_each_kernel_a_whole_log_is_the_same_answer(log: Path) -> None:
    for kernel in other_kernels():
        judge_elsewhere(log, "BLAS kernel", OPENBLAS_CORETYPE=kernel)


@pytest.mark.slow
def test_without_fused_multiply_add_it_is_the_same_answer(log: Path) -> None:
    """Neither numpy nor the C library may use what this processor has beyond the oldest one."""
    features = [name for name in HERE["cpu"].split() if name not in ("X86_V2", "SSE", "SSE2", "SSE3", "NEON", "ASIMD")]
    if features:
        judge_elsewhere(log, "CPU features", NPY_DISABLE_CPU_FEATURES=" ".join(features))
    if HERE["libm"].startswith("glibc") and platform.machine() == "x86_64":
        code, words, summary = elsewhere(log, GLIBC_TUNABLES="glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4")
        assert code == 0, words
        assert summary["estimates"]["different"] == 0


@pytest.mark.parametrize(
    ("how", "words"),
    [
        (other_numpy, f"the log was made with another arithmetic, numpy 1.26.4 (here {HERE['numpy']}): estimates are"),
        (unnamed, "the log does not name the arithmetic it was made with: estimates are compared within 1e-09"),
    ],
)
def test_a_log_of_elsewhere_or_of_an_older_station_is_compared_within_the_tolerance(
    how: Change, words: str, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said, summary = said_by(changed(short, tmp_path / "a.mcap", {("/session", 0): how}), capsys)
    assert code == 0
    assert words in said
    assert summary["estimates"]["equal"] == 120  # the same answer to the bit all the same

    last_bit = {("/session", 0): how, ("/estimates/ukf", 70): lambda fields: fields | {"digest": "0" * 16}}
    code, said, summary = said_by(changed(short, tmp_path / "b.mcap", last_bit), capsys)
    assert code == 0
    assert "estimates equal to the recorded ones: 119 of 120, 1 within the tolerance" in said
    assert (summary["estimates"]["near"], summary["first_difference"]) == (1, None)


def moved_by(by: float, name: str, digest: str | None = None) -> Change:
    """One number of an estimate is moved; its digest is kept, as by somebody who changes a log, or is another."""

    def change(fields: dict[str, Any]) -> dict[str, Any]:
        value = fields[name]
        moved = [value[0] + by, *value[1:]] if isinstance(value, list) else value + by
        return fields | {name: moved} | ({"digest": digest} if digest else {})

    return change


@pytest.mark.parametrize(
    ("digest", "name", "how"),
    [
        (None, "lat_deg", as_it_was),
        (None, "state", as_it_was),
        ("0" * 16, "state", other_numpy),
        (None, "heading_true_deg", other_numpy),
        ("0" * 16, "lat_deg", unnamed),
    ],
)
def test_an_estimate_that_is_another_by_a_millionth_is_a_difference(
    digest: str | None, name: str, how: Change, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = {("/session", 0): how, ("/estimates/ukf", 70): moved_by(1e-6, name, digest)}
    code, said, summary = said_by(changed(short, tmp_path / "a.mcap", changes), capsys)
    assert code == 1
    assert f"first difference: ukf at 7.100 s: {name}" in said
    assert (summary["estimates"]["different"], summary["estimates"]["missing"]) == (1, 0)


@pytest.mark.parametrize("how", [as_it_was, other_numpy])
def test_other_verdicts_are_listed_and_are_a_difference(
    how: Change, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = {
        ("/session", 0): how,
        ("/events", 0): lambda fields: fields | {"code": "filter-reset", "name": "filter-reset"},
        ("/estimates/ukf", 118): lambda fields: fields | {"aligned": False, "waiting": ["heading"]},
    }
    log = changed(short, tmp_path / "a.mcap", changes)
    code, said, summary = said_by(log, capsys)
    assert code == 1
    listed = [line for line in said.splitlines() if line.startswith("  ")]
    assert len(listed) == len(summary["verdicts"]) == 3
    assert [verdict["what"].split()[0] for verdict in summary["verdicts"]] == ["filter-reset", "filter-started", "ukf"]
    assert "what it waits for is " in listed[2]
    assert "recorded was heading" in listed[2]


def test_near_is_within_the_tolerance_in_every_number(log: Path) -> None:
    made = next(step for step in Replay(log) if step.t_s > 20.0).records[0]
    stored = logged(made)
    assert is_near(made, stored)
    for by, is_same in ((0.9 * TOLERANCE, True), (-0.9 * TOLERANCE, True), (2e-3, False)):
        for name in ("lat_deg", "lon_deg", "heading_true_deg", "sog_kn", "sigma_east_m", "sigma_heading_deg"):
            assert is_near(made, logged(made | {name: made[name] + by})) is is_same, name
        for place, _ in enumerate(made["state"]):
            state = [value + by * (number == place) for number, value in enumerate(made["state"])]
            assert is_near(made, logged(made | {"state": state})) is is_same, made["names"][place]
    for word, value in (("aligned", False), ("repairs", 1), ("waiting", ["heading"]), ("names", []), ("state", None)):
        assert not is_near(made, stored | {word: value}), word
    assert not is_near(made, {name: value for name, value in stored.items() if name != "covariance"})


def test_a_heading_of_due_south_is_near_on_either_side(log: Path) -> None:
    made = next(step for step in Replay(log) if step.t_s > 20.0).records[0]
    place = made["names"].index("heading_rad")

    def heading(rad: float) -> dict[str, Any]:
        return made | {"state": [*made["state"][:place], rad, *made["state"][place + 1 :]]}

    assert is_near(heading(math.pi), logged(heading(-math.pi + 1e-12)))
    assert not is_near(heading(math.pi), logged(heading(-math.pi + 1e-2)))


def test_the_quick_look_at_a_record_is_never_wrong(short: Path) -> None:
    """It says yes for every record as our writer wrote it; the slow comparison takes the others."""
    made = [record for step in Replay(short) for record in step.records]
    data = [record.data for record in read_log(short).records("/estimates/ukf")]
    assert all(map(is_stored_in, data, made))
    assert not any(map(is_stored_in, data, made[1:]))
