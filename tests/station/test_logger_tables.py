"""A guessed mapping of a stranger's table reads it right, asks, or refuses it; it is never quietly wrong."""

from pathlib import Path

import pytest

from shore.imports.column_map import read_column_map
from shore.main import main
from tests.station.logger_tables import TIMES, tables
from tests.station.logger_verdict import verdict
from tests.station.logger_voyage import Table


@pytest.mark.parametrize("table", [pytest.param(table, id=name) for name, table in tables()])
def test_a_table_is_read_right_or_not_at_all(table: Table, tmp_path: Path) -> None:
    found = verdict(table, tmp_path)
    for each in found.answered:  # whatever a person chooses, it is a mapping
        (tmp_path / "answered.toml").write_text(each, encoding="utf-8")
        read_column_map(tmp_path / "answered.toml")
    right = ("read", "asked", "refused") if table.right == "safe" else (table.right,)
    assert found.kind in right, f"{found.words}\n{found.text}"


def test_a_question_stands_in_the_proposal_and_the_exit_code_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = TIMES["AM and PM, an Australian"]
    path = tmp_path / "in.csv"
    path.write_bytes(table.data())
    assert main(["import", "--guess", str(path)]) == 1
    said = capsys.readouterr()
    assert '# format = "%d/%m/%Y %I:%M:%S %p"\n# format = "%m/%d/%Y %I:%M:%S %p"\n' in said.out
    assert "the day or the month first?" in said.err
    mapping = tmp_path / "map.toml"
    mapping.write_text(said.out)
    assert main(["import", str(path), str(tmp_path / "a.mcap"), "--map", str(mapping)]) == 2
    mapping.write_text(said.out.replace('# format = "%d', 'format = "%d'))
    assert main(["import", str(path), str(tmp_path / "a.mcap"), "--map", str(mapping)]) == 0
