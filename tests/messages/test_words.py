"""Words for people: one or many, the nearest known word, what to install and where from."""

import argparse
import re
from pathlib import Path

import pytest

from common.command import Parser
from common.words import counted, did_you_mean, how_to_install

REPOSITORY = Path(__file__).parents[2]


@pytest.mark.parametrize(("count", "words"), [(0, "0 ports"), (1, "1 port"), (2, "2 ports"), (12_034, "12,034 ports")])
def test_one_or_many(count: int, words: str) -> None:
    assert counted(count, "port") == words


def test_a_plural_of_its_own() -> None:
    assert [counted(count, "fix", "fixes") for count in (1, 2)] == ["1 fix", "2 fixes"]


def test_the_nearest_known_word() -> None:
    assert did_you_mean("fuzy", ("ukf", "fuzzy", "kf")) == ", did you mean fuzzy?"
    assert did_you_mean("xyz", ("ukf", "fuzzy")) == ""


def test_a_parser_names_the_nearest_command_and_choice(capsys: pytest.CaptureFixture[str]) -> None:
    parser = Parser(prog="p")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    commands.add_parser("connect").add_argument("--to", choices=("gpx", "kml"))
    commands.add_parser("replay")
    for given, meant in ((["conect"], "connect"), (["connect", "--to", "gpy"], "gpx")):
        with pytest.raises(SystemExit) as ended:
            parser.parse_args(given)
        assert ended.value.code == 2
        assert capsys.readouterr().err.rstrip().endswith(f", did you mean {meant}?")
    assert isinstance(parser, argparse.ArgumentParser)


def test_no_message_advises_a_name_on_an_index_that_is_not_ours() -> None:
    assert re.fullmatch(
        r".*python\S* -m pip install '\.\[report\]', in the directory of Wayfix", how_to_install("report")
    )
    sources = [path for room in ("common", "onboard", "shore") for path in (REPOSITORY / room).rglob("*.py")]
    texts = [*sources, *REPOSITORY.glob("docs/*.md"), REPOSITORY / "README.md", REPOSITORY / "Makefile"]
    assert len(texts) > 100
    assert [str(path) for path in texts if "install 'wayfix" in path.read_text(encoding="utf-8")] == []
