"""What the documents name is there: tests, modules, other documents."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("benchmarks/*.md")])


def named(pattern: str, document: Path) -> set[str]:
    return set(re.findall(pattern, document.read_text(encoding="utf-8")))


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_files_and_links_are_there(document: Path) -> None:
    files = named(r"`((?:common|onboard|shore|deploy|tests|benchmarks|docs)/[\w./-]+\.\w+)`", document)
    assert [name for name in sorted(files) if not (ROOT / name).exists()] == []
    links = named(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", document)
    assert [name for name in sorted(links) if not (document.parent / name).exists()] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_tests_are_there(document: Path) -> None:
    all_tests = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    names = named(r"`(test_\w+)`", document)
    assert [name for name in sorted(names) if f"def {name}(" not in all_tests] == []
