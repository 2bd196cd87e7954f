"""A public class has its package to itself: an import line and a search for the name say which one is meant."""

import ast
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
PACKAGES = ("common", "onboard", "shore")


def shared_names(files: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """Public class -> the files that define one, where they are several; from (file, source)."""
    found: defaultdict[str, list[str]] = defaultdict(list)
    for file, source in files:
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found[node.name].append(file)
    return {name: places for name, places in found.items() if len(places) > 1}


@pytest.mark.parametrize("package", PACKAGES)
def test_no_two_public_classes_of_a_package_share_a_name(package: str) -> None:
    files = sorted((REPOSITORY / package).rglob("*.py"))
    assert len(files) > 20
    shared = shared_names((str(file.relative_to(REPOSITORY)), file.read_text(encoding="utf-8")) for file in files)
    assert shared == {}


def test_a_shared_name_is_found_and_a_private_one_is_not() -> None:
    one, other = "class Gap: ...\nclass _Run: ...\nclass Only: ...\n", "class _Run: ...\nif True:\n    class Gap: ...\n"
    assert shared_names([("a.py", one), ("b.py", other)]) == {"Gap": ["a.py", "b.py"]}
