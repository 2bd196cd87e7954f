"""The tests of `common` and `onboard` once more, on Debian 12's own Python and libraries and without numpy."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.debian import LIBRARIES, PACKAGES, SYSTEM_PYTHON, has_libraries, make_wheel
from tests.recordings import REPOSITORY

pytestmark = pytest.mark.slow

FLOOR = {"pyzmq": "24.0.1", "msgpack": "1.0.3", "pyserial": "3.5", "pynmea2": "1.15.0"}
FOLDERS = ("tests/acquire", "tests/link", "tests/messages", "tests/service")
LEFT_OUT = {
    "tests/messages/test_geodesy.py": "compares with pyproj",
    "tests/service/test_systemd.py": "runs on this floor anyway",
}
"""Test files of these folders that need more than a board has, each with its reason."""
ENOUGH_TESTS = 600
VERSIONS = f"""
import json
from importlib.metadata import distribution
found = {{name: distribution(name) for name in {list(FLOOR)}}}
print(json.dumps({{name: [made.version, str(made.locate_file(""))] for name, made in found.items()}}))
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of an environment over Debian's packages; pytest, xdist and hypothesis are all that is added."""
    if not has_libraries(LIBRARIES):
        pytest.skip(f"Debian's Python packages are missing; apt-get install {PACKAGES}")
    directory = tmp_path_factory.mktemp("floor")
    environment = directory / "env"
    wheel = make_wheel(directory)
    subprocess.run([SYSTEM_PYTHON, "-m", "venv", "--system-site-packages", environment], check=True, timeout=120)
    pip: list[str | Path] = [environment / "bin" / "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run(
        [*pip, "-c", REPOSITORY / "constraints.txt", "pytest", "pytest-xdist", "hypothesis"], check=True, timeout=300
    )
    subprocess.run([*pip, "--no-deps", "--no-index", wheel], check=True, timeout=120)
    (packages,) = environment.glob("lib/python3*/site-packages")
    shutil.copy(Path(__file__).parent / "only_the_board.py", packages)
    (packages / "only_the_board.pth").write_text("import only_the_board\n", encoding="ascii")
    return environment / "bin" / "python"


@pytest.mark.parametrize(
    ("which", "enough", "workers"),
    [("not alone", ENOUGH_TESTS, 2), pytest.param("alone", 1, 0, marks=pytest.mark.in_pairs)],
)
def test_common_and_onboard_pass_their_tests_on_the_floor(
    python: Path, tmp_path: Path, which: str, enough: int, workers: int
) -> None:
    versions = json.loads(subprocess.check_output([python, "-c", VERSIONS], text=True))
    if {name: version for name, (version, _) in versions.items()} != FLOOR:
        pytest.skip(f"this is not Debian 12, the floor: {versions}")
    assert {place for _, place in versions.values()} == {"/usr/lib/python3/dist-packages"}

    report = tmp_path / "report.xml"
    line: list[str | Path] = [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"--junit-xml={report}", *FOLDERS]
    line += ["-m", which, "-n", str(workers)]
    line += [f"--ignore={file}" for file in LEFT_OUT]
    done = subprocess.run(line, cwd=REPOSITORY, capture_output=True, text=True, timeout=900, check=False)
    print(done.stdout[-300:])
    assert done.returncode == 0, done.stdout[-6000:]
    assert report.read_text(encoding="utf-8").count("<testcase ") >= enough
