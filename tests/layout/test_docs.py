"""What the documents name is there: tests, modules, rooms, other documents; and every module says what it is."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("benchmarks/*.md")])
PACKAGES = ("common", "onboard", "shore")
ROOMS = (ROOT / "docs" / "rooms.md").read_text(encoding="utf-8")
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def named(pattern: str, document: Path) -> set[str]:
    return set(re.findall(pattern, document.read_text(encoding="utf-8")))


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_files_and_links_are_there(document: Path) -> None:
    files = named(r"`((?:common|onboard|shore|deploy|tests|benchmarks|docs)/[\w./-]+\.\w+)`", document)
    assert [name for name in sorted(files) if not (ROOT / name).exists()] == []
    links = named(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", document)
    assert [name for name in sorted(links) if not (document.parent / name).exists()] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_into_a_page_meet_a_heading(document: Path) -> None:
    for target, anchor in sorted(set(re.findall(r"\]\(([^)#:\s]*)#([^)]+)\)", document.read_text(encoding="utf-8")))):
        page = document.parent / target if target else document
        assert anchor in anchors_of(page.read_text(encoding="utf-8")), f"{document.name}: {target}#{anchor}"


def anchors_of(text: str) -> set[str]:
    """As GitHub and GitLab make them of headings."""
    headings = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_tests_are_there(document: Path) -> None:
    all_tests = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    names = named(r"`(test_\w+)`", document)
    assert [name for name in sorted(names) if f"def {name}(" not in all_tests] == []


def rows_of(page: str) -> set[str]:
    """What the first cells of tables name."""
    cells = re.findall(r"^\| (`[^|]+) \|", page, flags=re.MULTILINE)
    return {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)}


def files_of_rooms(page: str) -> dict[str, set[str]]:
    """Room -> the files in the table under its heading, which is the folder's path."""
    parts = re.split(r"^### `([^`]+/)`$", page, flags=re.MULTILINE)
    tables = (re.split(r"^##", table, flags=re.MULTILINE)[0] for table in parts[2::2])
    return {room: rows_of(table) for room, table in zip(parts[1::2], tables, strict=True)}


def absent(page: str, root: Path) -> list[str]:
    """Paths of the page that are not there; `<...>` stands for a name that somebody will choose."""
    paths = {name for name in re.findall(r"`([^`\s]+/[^`\s]*)`", page) if name.split("/")[0] in PACKAGES}
    paths |= {f"{room}{name}" for room, files in files_of_rooms(page).items() for name in files}
    return sorted(name for name in paths if "<" not in name and not (root / name).exists())


def test_every_package_has_a_line_in_rooms() -> None:
    folders = {f"{path.parent.relative_to(ROOT)}/" for path in MODULES if path.name == "__init__.py"}
    assert folders - {"onboard/", "shore/"} - rows_of(ROOMS.split("\n## Files")[0]) == set()


def test_every_file_at_the_top_of_a_side_has_a_line_in_rooms() -> None:
    files = {
        str(path.relative_to(ROOT)) for path in MODULES if path.parent.parent == ROOT and path.parent.name != "common"
    }
    assert {name for name in files if not name.endswith("__init__.py")} - rows_of(ROOMS.split("\n## Files")[0]) == set()


def test_every_path_in_rooms_is_there() -> None:
    assert absent(ROOMS, ROOT) == []
    assert len(files_of_rooms(ROOMS)) > 10


def test_a_path_that_is_not_there_is_caught() -> None:
    page = (
        "`onboard/nowhere/` and `shore/main.py`\n\n### `common/`\n\n| `codec.py`, `gone.py` | both |\n\n### An idea\n"
    )
    assert absent(page, ROOT) == ["common/gone.py", "onboard/nowhere/"]


def first_line(module: Path) -> str:
    return (ast.get_docstring(ast.parse(module.read_text(encoding="utf-8"))) or "").split("\n")[0]


def test_every_module_begins_with_a_sentence_about_itself() -> None:
    """A capital letter or a command's name first, a full stop last."""
    lines = {str(path.relative_to(ROOT)): first_line(path) for path in MODULES}
    assert {name: line for name, line in lines.items() if not is_sentence(line)} == {}


def is_sentence(line: str) -> bool:
    return re.fullmatch(r"[A-Z`].*\w.*[.!?]", line) is not None or re.fullmatch(r"[a-z]+'s .*\.", line) is not None


@pytest.mark.parametrize("line", ["", "Reads", "reads lines.", "Reads lines and"])
def test_what_is_no_sentence_is_caught(line: str) -> None:
    assert not is_sentence(line)


def test_every_decision_has_a_place_in_the_index() -> None:
    page = (ROOT / "docs" / "decisions.md").read_text(encoding="utf-8")
    index, entries = page.split("\n## Entries\n")
    subjects = index.split("\n| entry | status |")[0]
    placed = {
        int(number) for row in re.findall(r"\| ([\d, ]+) \|$", subjects, re.MULTILINE) for number in row.split(",")
    }
    numbers = [int(number) for number in re.findall(r"^(\d+)\. \*\*", entries, re.MULTILINE)]
    assert numbers == list(range(1, len(numbers) + 1))
    assert placed == set(numbers)
