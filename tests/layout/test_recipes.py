"""The recipes of docs/rooms.md: each is applied to a copy of the tree and run, and touches the files it names."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.layout.additions import (
    ANSWERED,
    ASKED,
    ASKING,
    COMMAND,
    DRIVER,
    FORMAT,
    READER,
    RULE,
    SCENARIO,
    SENTENCE,
    SPOKEN,
    SUBCOMMAND,
    WATCHER,
)
from tests.layout.tree import REPOSITORY, Tree

COPIED = ("common", "onboard", "shore")
PAGE = (REPOSITORY / "docs" / "rooms.md").read_text(encoding="utf-8")
LOG = REPOSITORY / "tests" / "golden" / "straight" / "log.mcap"


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    for package in COPIED:
        shutil.copytree(REPOSITORY / package, tmp_path / package)
    return Tree(tmp_path)


def named_in(recipe: str) -> list[str]:
    """The files in the table of a recipe; `<...>` stands for a name to be chosen."""
    section = re.split(r"^##+ ", PAGE.split(f"\n### {recipe}\n")[1], maxsplit=1, flags=re.MULTILINE)[0]
    return re.findall(r"^\| `([^`]+)` \|", section, flags=re.MULTILINE)


def is_as_named(touched: set[str], named: list[str]) -> bool:
    """Each named file was touched, and no other."""
    patterns = [re.sub(r"<[^>]+>", r"[^/]+", re.escape(name).replace(r"\<", "<").replace(r"\>", ">")) for name in named]
    return len(touched) == len(named) and all(
        any(re.fullmatch(pattern, path) for path in touched) for pattern in patterns
    )


def model_of_sensor(tree: Tree) -> None:
    tree.new("onboard/devices/compass/plain.py", DRIVER)
    registry = "onboard/devices/registry.py"
    tree.after(
        registry,
        "from onboard.devices.compass.tcm2",
        "from onboard.devices.compass.plain import PlainDriver, PlainEncoder\n",
    )
    tree.after(registry, "MODELS:", '    ("compass", "plain"): Model(PlainDriver, PlainEncoder),\n')
    tree.new("plain.log", "H001.5\nH002.5\nHello\n")
    tree.new(
        "boat.toml",
        '[boat]\nid = "boat"\n[[port]]\nname = "bow"\npath = "/dev/null"\n'
        '[[sensor]]\nid = "compass1"\nport = "bow"\nrole = "compass"\nmodel = "plain"\n',
    )
    said = tree.on_board("convert", "plain.log", "out.frames", "--config", "boat.toml", "--json")
    assert '"PLAIN": 2' in said
    assert '"not-a-number": 1' in said
    assert tree.python("-c", SPOKEN) == "b'H359.5\\n'\n"


def sentence(tree: Tree) -> None:
    path = "onboard/devices/compass/sentences.py"
    tree.after(path, "HTM: Final", SENTENCE)
    tree.within(path, "NMEA: Final[Forms] = {", 'NMEA: Final[Forms] = {"THS": THS, ')
    tree.within(path, "RANK: Final[Mapping[str, int]] = {", 'RANK: Final[Mapping[str, int]] = {"THS": 0, ')
    said = tree.python(
        "-c",
        "from common.boat_config import SensorTable\n"
        "from onboard.devices.driver import Line\n"
        "from onboard.devices.registry import make_driver\n"
        "driver = make_driver(SensorTable(id='compass1', port='bow', role='compass'))\n"
        "line = Line(0, b'$HETHS,123.4,A*29')\n"
        "print(driver.claims(line), driver.feed(line))",
    )
    assert "True Accepted" in said
    assert "heading_true_deg=123.4" in said


def happening(tree: Tree) -> None:
    row = '    "bilge-wet": EventKind("warning", "{depth_mm} mm of water in the bilge", "pump it out"),\n'
    tree.after("common/event_kinds.py", "EVENTS:", row)
    said = tree.python(
        "-c",
        "from common.codec import decode_frame, encode_frame\n"
        "from common.events import event, line_of\n"
        "from common.messages import Frame\n"
        "happening = event('bilge-wet', 5_000, 'daemon', depth_mm=30)\n"
        "frame = Frame(boat_id='b', boot_id='0', seq=0, clock_id='c', start_no=1, t0_ns=0, t1_ns=10_000,\n"
        "              events=(happening,))\n"
        "print(line_of(decode_frame(encode_frame(frame)).events[0]))",
    )
    assert said == "30 mm of water in the bilge; pump it out\n"


def replayed(tree: Tree, name: str) -> str:
    return tree.wayfix("replay", LOG, "--filters", name, "--json")


def new_filter(tree: Tree) -> None:
    tree.after("shore/navigation/filter_registry.py", "REGISTRY:", '    "ekf-fuzzy": (predict_extended, "fuzzy"),\n')
    assert '"ekf-fuzzy"' in replayed(tree, "ekf-fuzzy")


def noise_rule(tree: Tree) -> None:
    tree.new("shore/navigation/noise/doubled.py", RULE)
    path = "shore/navigation/noise/rules.py"
    tree.after(path, "from shore.navigation.noise.noise_rule", "from shore.navigation.noise.doubled import Doubled\n")
    tree.after(path, "NOISE_RULES:", '    "doubled": Doubled(),\n')
    assert '"doubled"' in replayed(tree, "doubled")


def export_format(tree: Tree) -> None:
    tree.new("shore/exports/lines.py", FORMAT)
    row = '    "lines": Format(f"{_HERE}.lines", lambda head: head.startswith(b"here")),\n'
    tree.after("shore/exports/formats.py", "FORMATS:", row)
    assert "lines" in tree.wayfix("export", "--help")
    tree.wayfix("export", LOG, "out.lines", "--to", "lines", "--filter", "raw")
    assert (tree.root / "out.lines").read_text(encoding="ascii").startswith("here\nhere\n")


def import_kind(tree: Tree) -> None:
    tree.new("shore/imports/places.py", READER)
    kinds, run = "shore/imports/recognise.py", "shore/imports/run.py"
    tree.after(kinds, "class RecordingKind(StrEnum):", '    PLACES = "list of places"\n')
    tree.after(
        kinds, "_refuse_magic(path, head)", '    if head.startswith(b"place "):\n        return RecordingKind.PLACES\n'
    )
    tree.after(run, "from shore.imports.part", "from shore.imports.places import PlacesReader\n")
    case = "        case RecordingKind.PLACES:\n"
    made = "            return _from_reader(job, lambda progress: PlacesReader(Lines(job.source, progress)))\n"
    tree.after(run, "match job.kind:", case + made)
    (tree.root / "places").write_text("place 50.0 -4.0\nplace 50.1 -4.0\n", encoding="ascii")
    said = tree.wayfix("import", "places", "out.mcap", "--filters", "none", "--json")
    assert '"kind": "list of places"' in said
    assert '"usable_fixes": 2' in said


def command_ashore(tree: Tree) -> None:
    tree.new("shore/report/size.py", COMMAND)
    main = "shore/main.py"
    tree.after(main, "from shore.replay.command", "from shore.report.size import add_arguments as add_size_arguments\n")
    tree.after(
        main, '_add(commands, "pair"', '    _add(commands, "size", "bytes of a log", add_size_arguments, _size)\n'
    )
    run = '\ndef _size(arguments: argparse.Namespace) -> int:\n    """Bytes of a log."""\n'
    work = "    from shore.report.size import run\n\n    return run(arguments)\n\n"
    tree.after(main, 'DEMO_FILTERS = "', run + work)
    assert "bytes of a log" in tree.wayfix("--help")
    assert tree.wayfix("size", LOG) == f"{LOG.stat().st_size}\n"


def command_on_board(tree: Tree) -> None:
    tree.new("onboard/recorded/count.py", SUBCOMMAND)
    main = "onboard/main.py"
    tree.after(main, "from onboard.recorded import command as convert", "    from onboard.recorded import count\n")
    tree.within(main, "in (run, check, listen, convert,", "in (run, check, listen, convert, count,")
    assert "count the lines" in tree.on_board("--help")
    (tree.root / "recording").write_text("$GP\n$GP\n", encoding="ascii")
    assert tree.on_board("lines", "recording") == "2\n"


def request_to_the_daemon(tree: Tree) -> None:
    commands, command = "onboard/control/handlers.py", "onboard/control/command.py"
    tree.after(commands, '"""For the control socket."""', ASKED)
    tree.within(commands, '"mark": mark}', '"mark": mark, "sensors": sensors}')
    tree.after(command, '_add(commands, "keys"', '    _add(commands, "sensors", "all sensors", _sensors)\n')
    tree.after(command, "ANSWER_S = 15", ASKING)
    assert tree.python("-c", ANSWERED) == "gps1 imu1\n"


def scenario(tree: Tree) -> None:
    tree.after("common/simulation/scenarios_own.py", "OWN: Final", SCENARIO)
    assert "straight to one buoy" in tree.wayfix("lab", "list")
    tree.python("-c", "from common.simulation.scenarios import scenario_voyage\nscenario_voyage('there', seconds=5.0)")


def watcher(tree: Tree) -> None:
    tree.new("shore/watchers/counter.py", WATCHER)
    command = "shore/replay/command.py"
    tree.after(command, "from shore.watchers.log import", "        from shore.watchers.counter import Counter\n")
    tree.within(command, "watchers: list[Watcher] = [", "watchers: list[Watcher] = [Counter(), ")
    said = replayed(tree, "ukf")
    counted = re.search(r"counted (\d+)", said)
    assert counted is not None
    assert f'"read": {counted[1]}' in said


RECIPES: dict[str, Callable[[Tree], None]] = {
    "A model of sensor": model_of_sensor,
    "A sentence of a known family": sentence,
    "An event": happening,
    "A filter": new_filter,
    "A noise rule": noise_rule,
    "An export format": export_format,
    "An import kind": import_kind,
    "A command ashore": command_ashore,
    "A command on board": command_on_board,
    "A request to the running daemon": request_to_the_daemon,
    "A simulated scenario": scenario,
    "A watcher": watcher,
}


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_recipe_works_and_touches_the_files_it_names(recipe: str, tree: Tree) -> None:
    RECIPES[recipe](tree)
    assert is_as_named(tree.touched, named_in(recipe)), (sorted(tree.touched), named_in(recipe))


def test_every_recipe_of_the_page_is_tried() -> None:
    recipes = PAGE.split("\n## Recipes\n")[1]
    assert re.findall(r"^### (.+)$", recipes, flags=re.MULTILINE) == list(RECIPES)


def test_a_recipe_that_names_too_few_or_other_files_is_caught() -> None:
    named = ["onboard/devices/<family>/<model>.py", "onboard/devices/registry.py"]
    right = {"onboard/devices/compass/plain.py", "onboard/devices/registry.py"}
    assert is_as_named(right, named)
    assert not is_as_named({*right, "onboard/config.py"}, named)
    assert not is_as_named({"onboard/devices/registry.py"}, named)
    assert not is_as_named({"onboard/devices/compass/plain.py", "onboard/config.py"}, named)
