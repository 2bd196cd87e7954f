import math
import tomllib
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from common.toml_text import toml_lines, toml_text

SCALARS = st.one_of(st.text(), st.booleans(), st.integers(), st.floats(allow_nan=False), st.none())
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=20,
)
TABLES = st.dictionaries(st.text(max_size=8), VALUES, max_size=6)


def without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list):
        return [without_none(item) for item in value if item is not None]
    return value


@given(TABLES)
def test_what_is_written_reads_back(table: dict[str, Any]) -> None:
    assert tomllib.loads(toml_text(table)) == without_none(table)


@given(TABLES)
def test_no_letter_of_a_text_can_steer_a_terminal(table: dict[str, Any]) -> None:
    assert all(line.lstrip("\n").isprintable() for line in toml_lines(table))


def test_whole_numbers_real_numbers_and_truth_keep_their_type() -> None:
    read = tomllib.loads(toml_text({"whole": 1, "real": 1.0, "true": True, "large": 1e16, "odd": math.nan}))
    assert [type(value) for value in read.values()] == [int, float, bool, float, float]
    assert math.isnan(read["odd"])


def test_plain_values_come_first_and_every_table_has_an_empty_line_before_it() -> None:
    table = {"boat": {"id": "b", "none": None}, "port": [{"name": "p"}, {"name": "q", "use": ["x"]}], "n": 3e-9}
    assert toml_text(table) == (
        'n = 3e-09\n\n[boat]\nid = "b"\n\n[[port]]\nname = "p"\n\n[[port]]\nname = "q"\nuse = ["x"]\n'
    )


def test_a_name_that_is_no_bare_key_is_quoted_in_every_place() -> None:
    table = {"a b": {"c.d": {"": 1}}, "e": [1, {"f g": 2}]}
    assert toml_text(table) == 'e = [1, {"f g" = 2}]\n\n["a b"]\n\n["a b"."c.d"]\n"" = 1\n'
