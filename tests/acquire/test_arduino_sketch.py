"""The Arduino sketch of the rate gyro, compiled on this computer: what it writes, our driver reads."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from common.boat_config import SensorTable
from common.messages import TurnRate
from onboard.devices import Accepted, Line, Outcome, Rejected, make_driver
from onboard.reading.line_splitter import LineSplitter
from tests.acquire.sentences import line, measured

SKETCH = Path(__file__).parents[2] / "deploy" / "arduino" / "tinkerkit_gyro"
README = SKETCH.parent / "README.md"
GYRO = SensorTable(id="gyro1", port="p", role="gyro", model="tinkerkit")

FORMATTING = """
#include <stdio.h>
#include "wayfix_line.h"

int main() {
  char kind, status;
  long long a, b, c, d;
  while (scanf(" %c %c %lld %lld %lld %lld", &kind, &status, &a, &b, &c, &d) == 6) {
    if (kind == 'L') {
      char out[wayfix::kLongestLine];
      const size_t length = wayfix::write_line(out, (uint32_t)a, status, (int32_t)b, (uint16_t)c);
      fwrite(out, 1, length, stdout);
    } else {
      const wayfix::Scale scale = {5000000, 2680, 375, (int8_t)(status == '+' ? 1 : -1)};
      wayfix::Block block;
      block.sum = (uint32_t)a;
      block.samples = (uint16_t)b;
      const int32_t uv = wayfix::mean_uv(block, scale);
      const int32_t rate = wayfix::rate_mdeg_s(uv, (int32_t)c, scale);
      printf("%ld %ld %d\\n", (long)uv, (long)rate, wayfix::is_saturated(block, rate, scale) ? 1 : 0);
    }
  }
}
"""

# The sketch itself between a clock that steps 0.5 ms a reading and a gyro that plays the numbers of standard input.
SIMULATION = """
#include <stdint.h>
#include <stdio.h>
const int A0 = 54, DEFAULT = 1, INTERNAL2V56 = 2;
static uint64_t half_ms = HALF_MS_AT_START;
static int level = 0;
uint32_t millis() { return (uint32_t)(half_ms / 2); }
int analogRead(int) { half_ms += 1; return level; }
void analogReference(int) {}
struct Port {
  void begin(unsigned long) {}
  void write(const uint8_t* data, size_t length) { fwrite(data, 1, length, stdout); }
} Serial;
#include "tinkerkit_gyro.ino"
int main() {
  int readings;
  bool first = true;
  while (scanf("%d %d", &readings, &level) == 2) {
    if (first) setup();
    first = false;
    for (int n = 0; n < readings; ++n) loop();
  }
}
"""


def built(folder: Path, source: str, *options: str) -> Path:
    """The program of `source`, which includes files of the sketch."""
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("g++ is not installed: the Arduino sketch cannot be compiled here")
    (folder / "main.cpp").write_text(source, encoding="utf-8")
    command = [compiler, "-std=c++11", "-Wall", "-Wextra", "-Werror", *options, f"-I{SKETCH}", "-o", "program"]
    subprocess.run([*command, "main.cpp"], cwd=folder, check=True, timeout=60)
    return folder / "program"


def ran(program: Path, text: str) -> bytes:
    return subprocess.run([program], input=text.encode(), stdout=subprocess.PIPE, check=True, timeout=60).stdout


def decoded(data: bytes) -> list[Outcome]:
    driver = make_driver(GYRO)
    lines = LineSplitter().feed(data, 0)
    assert all(driver.claims(one) for one in lines)
    return [driver.feed(one) for one in lines]


def rates(outcomes: list[Outcome]) -> list[float]:
    found = [measurement for outcome in outcomes for measurement in measured(outcome)]
    return [one.rate_deg_s for one in found if isinstance(one, TurnRate)]


@pytest.fixture(scope="module")
def formatting(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("formatting"), FORMATTING)


def test_every_line_of_the_sketch_is_read_back_to_the_digit(formatting: Path) -> None:
    values = [0, 1, -1, 9, -10, 999, -1000, 1234, -374_999, 375_000, 1_500_000, -1_500_000, 2_000_000, -2_000_000]
    values += [7919 * n - 1_900_000 for n in range(480)]
    clocks = [0, 1, 2**31 - 1, 2**31, 2**32 - 1]
    wanted = [(clocks[n % 5], value, 1 + 65_534 * (n % 3) // 2) for n, value in enumerate(values)]
    output = ran(formatting, "".join(f"L A {now} {rate} {samples} 0\n" for now, rate, samples in wanted))
    assert output.count(b"\r\n") == len(wanted)
    assert max(len(one) for one in output.splitlines()) <= 80
    assert rates(decoded(output)) == [rate / 1000.0 for _, rate, _ in wanted]


def test_zeroing_and_saturated_lines(formatting: Path) -> None:
    output = ran(formatting, f"L Z 4294967295 77 440 0\nL S 5 {-(2**31)} 65535 0\nL S 5 {2**31 - 1} 1 0\n")
    assert decoded(output) == [Accepted("gyro1", "PWFXG"), *[Rejected("saturated", "gyro1")] * 2]
    assert max(len(one) for one in output.splitlines(keepends=True)) <= 42


def test_scaling_is_rounded_half_away_from_zero(formatting: Path) -> None:
    cases = [
        (samples * reading + more, samples, zero_uv, sign)
        for samples in (1, 3, 440, 65_535)
        for reading in (0, 1, 251, 252, 512, 1022)
        for more in (0, samples // 3)
        for zero_uv in (1_230_000, 2_500_000)
        for sign in "+-"
    ]
    output = ran(formatting, "".join(f"R {sign} {total} {n} {zero} 0\n" for total, n, zero, sign in cases))
    for (total, samples, zero_uv, sign), text in zip(cases, output.decode().splitlines(), strict=True):
        uv, rate, saturated = map(int, text.split())
        assert uv == (2 * total * 5_000_000 + samples * 1024) // (2 * samples * 1024)
        size = (2000 * abs(uv - zero_uv) + 2680) // (2 * 2680)
        assert rate == (size if (uv > zero_uv) == (sign == "+") else -size)
        assert saturated == (abs(rate) > 375_000)


@pytest.mark.parametrize("start_ms", [0, 2**32 - 7000])
def test_the_whole_sketch_zeroes_measures_and_saturates(tmp_path: Path, start_ms: int) -> None:
    """A boat that turns while the sketch zeroes, rests, turns to starboard, to port, and hits the rail."""
    program = built(tmp_path, SIMULATION, f"-DHALF_MS_AT_START={2 * start_ms}ULL")
    script = [(2000, 300), (9980, 252), (2000, 252), (400, 262), (400, 232), (400, 1023)]
    outcomes = decoded(ran(program, "".join(f"{readings} {level}\n" for readings, level in script)))
    kinds = ["".join("R" if isinstance(one, Rejected) else "ZA"[len(measured(one))] for one in outcomes)]
    assert re.fullmatch("Z{119,121}A{27,29}R{4}", kinds[0]), kinds
    found = rates([one for one in outcomes if isinstance(one, Accepted)])
    step = 5000 / 1024 / 2.68
    assert found[2] == pytest.approx(0.0, abs=0.001)
    assert found[-7] == pytest.approx(10 * step, abs=0.01)
    assert found[-2] == pytest.approx(-20 * step, abs=0.01)


def test_the_examples_of_the_readme_are_right() -> None:
    examples = re.findall(r"^\$PWFXG,[0-9].*$", README.read_text(encoding="utf-8"), re.MULTILINE)
    driver = make_driver(GYRO)
    zeroing, turning = [driver.feed(Line(0, one.encode())) for one in examples]
    assert zeroing == Accepted("gyro1", "PWFXG")
    assert driver.feed(line(examples[1].encode())) == turning
    assert rates([turning]) == [-1.234]
