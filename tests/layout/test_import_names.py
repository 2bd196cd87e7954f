"""Guards of our plain package names, and of what the board may import.

`common` is a name others use too: in an editable install a foreign `common` wins, with wheels the last one does.
"""

import importlib.metadata
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import pytest

import common
import onboard
import shore

PACKAGES = ("common", "onboard", "shore")
REPOSITORY = Path(__file__).parents[2]


def parents_fault(modules: Mapping[str, ModuleType]) -> str | None:
    """Why the packages are not all ours: they do not share one parent directory."""
    parents = {name: Path(str(module.__file__)).resolve().parents[1] for name, module in modules.items()}
    return None if len(set(parents.values())) == 1 else f"packages come from different places: {parents}"


def distributions_fault(distributions: Mapping[str, list[str]]) -> str | None:
    """Why the packages are not all ours: another distribution installed one too (editable installs are not listed)."""
    foreign = {name: set(distributions.get(name, [])) - {"wayfix"} for name in PACKAGES}
    named = {name: sorted(owners) for name, owners in foreign.items() if owners}
    return f"other distributions install our names: {named}" if named else None


def fake(name: str, directory: str) -> ModuleType:
    module = ModuleType(name)
    module.__file__ = f"{directory}/{name}/__init__.py"
    return module


def test_our_packages_share_one_parent_directory() -> None:
    assert parents_fault({"common": common, "onboard": onboard, "shore": shore}) is None
    assert Path(common.__file__).resolve().parents[1] == REPOSITORY


def test_our_names_belong_to_no_other_distribution() -> None:
    assert distributions_fault(importlib.metadata.packages_distributions()) is None


def test_a_foreign_common_is_caught() -> None:
    modules = {"common": fake("common", "/elsewhere"), "onboard": fake("onboard", "/a"), "shore": fake("shore", "/a")}
    assert "/elsewhere" in str(parents_fault(modules))
    assert parents_fault({**modules, "common": fake("common", "/a")}) is None


@pytest.mark.parametrize("owners", [["wayfix", "other"], ["other"]])
def test_a_foreign_distribution_is_caught(owners: list[str]) -> None:
    assert "other" in str(distributions_fault({"common": owners, "numpy": ["numpy"]}))
    assert distributions_fault({"common": ["wayfix"], "shore": ["wayfix"]}) is None


_IMPORT_ALL = """
import importlib, pkgutil, sys
for name in {blocked!r}:
    sys.modules[name] = None
for package, left_out in {packages!r}:
    for module in pkgutil.walk_packages(importlib.import_module(package).__path__, package + "."):
        if not (module.name + ".").startswith(left_out + "."):
            importlib.import_module(module.name)
            print(module.name)
"""


def import_all(packages: list[tuple[str, str]], blocked: list[str]) -> subprocess.CompletedProcess[str]:
    """Import every module of each package but those below its second name, in a fresh Python without `blocked`."""
    program = _IMPORT_ALL.format(packages=packages, blocked=blocked)
    return subprocess.run(
        [sys.executable, "-c", program], cwd=REPOSITORY, capture_output=True, text=True, check=False, timeout=60
    )


def test_the_daemon_and_common_import_without_the_stations_libraries() -> None:
    packages = [("common", "common.simulation"), ("onboard", "onboard.virtual")]
    done = import_all(packages, ["numpy", "scipy", "pyais", "mcap", "shore"])
    assert done.returncode == 0, done.stderr
    imported = done.stdout.split()
    assert {"common.codec", "common.link_messages", "onboard.devices.driver"} <= set(imported)
    assert not any("virtual" in name or "simulation" in name for name in imported)


def test_the_block_is_noticed_when_a_module_needs_what_is_blocked() -> None:
    done = import_all([("common", "common.simulation")], ["msgpack"])
    assert done.returncode != 0
    assert "msgpack" in done.stderr


def test_no_test_folder_is_a_package_or_named_like_one() -> None:
    tests = REPOSITORY / "tests"
    assert not list(tests.rglob("__init__.py"))
    assert not {folder.name for folder in tests.iterdir()} & set(PACKAGES)
