"""An attribute's docstring says what the attribute is: a shape, a unit or a sign alone is a riddle."""

import ast
import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
PACKAGES = ("common", "onboard", "shore")
LEAST_WORDS = 3
FRAGMENTS = ("Of", "By", "Since", "Their", "Its")


def attribute_docstrings(source: str) -> Iterator[tuple[int, str]]:
    """(line, text) of each docstring that follows an assignment."""
    for node in ast.walk(ast.parse(source)):
        body = getattr(node, "body", None)
        for before, after in pairwise(body if isinstance(body, list) else ()):
            if not isinstance(before, ast.Assign | ast.AnnAssign) or not isinstance(after, ast.Expr):
                continue
            if isinstance(after.value, ast.Constant) and isinstance(after.value.value, str):
                yield after.lineno, after.value.value


def is_riddle(text: str) -> bool:
    """Too few words, or the answer to a question that nothing asks ("Of the records.").

    A word has three letters or more; what stands in backticks or parentheses, such as a shape, is none.
    """
    plain = re.sub(r"`[^`]*`|\([^()]*\)", " ", text)
    words = re.findall(r"(?<![\w/^])[^\W\d_]{3,}", plain)
    return len(words) < LEAST_WORDS or text.split(maxsplit=1)[0] in FRAGMENTS or not re.match(r"[A-Z0-9`]", text)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_attribute_docstring_is_a_riddle(package: str) -> None:
    found = [
        (f"{file.relative_to(REPOSITORY)}:{line}", text)
        for file in sorted((REPOSITORY / package).rglob("*.py"))
        for line, text in attribute_docstrings(file.read_text(encoding="utf-8"))
    ]
    assert len(found) > 100
    assert [(place, text) for place, text in found if is_riddle(text)] == []


@pytest.mark.parametrize(
    "text",
    [
        "(k,)",
        "Z85.",
        "m/s^2/sqrt(Hz), both axes.",
        "+ bow up.",
        "Mean (..., n).",
        "Of the records.",
        "Since the answer.",
    ],
)
def test_a_riddle_is_caught(text: str) -> None:
    source = f'class Run:\n    count: int\n    """{text}"""\n'
    assert [is_riddle(each) for _, each in attribute_docstrings(source)] == [True]


@pytest.mark.parametrize("text", ["Pitch of the boat, deg, + bow up.", "Mean of the state, (..., n)."])
def test_what_says_what_it_is_is_no_riddle(text: str) -> None:
    assert not is_riddle(text)
