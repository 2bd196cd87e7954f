from pathlib import Path

import pytest

from common.errors import SettingsError
from onboard.config import byte_budget, load

EXAMPLE = Path(__file__).parents[2] / "deploy" / "examples" / "boat.toml"


def test_the_example_is_right_and_explains_every_key() -> None:
    from dataclasses import fields

    from common.boat_config import BoatTable, FramesTable, LinkTable, PortTable, SensorTable

    load(EXAMPLE)
    text = EXAMPLE.read_text(encoding="utf-8")
    for table in (BoatTable, FramesTable, LinkTable, PortTable, SensorTable):
        for field in fields(table):
            assert f"{field.name} =" in text, f"{field.name} is not explained in boat.toml"


def test_all_faults_are_told_at_once_with_file_and_key(tmp_path: Path) -> None:
    file = tmp_path / "boat.toml"
    file.write_text(
        """
[boat]
id = "x"
[[port]]
name = "a"
path = "/dev/ttyUSB0"
[[port]]
name = "a"
path = "/dev/ttyUSB0"
[[sensor]]
id = "gps1"
port = "b"
role = "gps"
[[sensor]]
id = "compass"
port = "a"
role = "compass"
[[sensor]]
id = "imu1"
port = "a"
role = "gyro"
[[sensor]]
id = "imu2"
port = "a"
role = "imu"
model = "arduimux"
""",
        encoding="utf-8",
    )
    with pytest.raises(SettingsError) as caught:
        load(file)
    text = str(caught.value)
    for part in (
        "name given twice",
        "path /dev/ttyUSB0 given twice",
        "no [[port]] is named b",
        "like compass1",
        "gyro does not fit",
        "arduimu",
    ):
        assert part in text
    assert all(line.startswith(str(file)) for line in text.splitlines())


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "boat: missing"),
        ("[boat\n", "not valid TOML"),
        ("[boat]\nid = 'x'\n", "[[port]]: none given"),
        ("[boat]\nid = 'x'\nwarp = 9\n", "boat.warp: unknown key"),
        ("[boat]\nid = 'x'\n[frames]\nrate_hz = 50\n", "frames.rate_hz: must be <= 20, got 50"),
        ("[boat]\nid = 'x'\n[frames]\nrate_hz = 3\n", "frames.rate_hz: must be one of 1, 2, 4"),
    ],
)
def test_broken_files_name_key_and_cure(tmp_path: Path, text: str, part: str) -> None:
    file = tmp_path / "boat.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SettingsError, match=r"boat\.toml") as caught:
        load(file)
    assert part in str(caught.value)


@pytest.mark.parametrize(
    ("first", "second", "is_right"),
    [("[]", "[]", False), ('["GP"]', "[]", False), ('["GP"]', '["GP", "GN"]', False), ('["GP"]', '["GN"]', True)],
)
def test_two_sensors_of_a_role_on_one_port_need_different_talkers(
    tmp_path: Path, first: str, second: str, is_right: bool
) -> None:
    sensors = "".join(
        f'[[sensor]]\nid = "gps{number}"\nport = "a"\nrole = "gps"\ntalkers = {talkers}\n'
        for number, talkers in ((1, first), (2, second))
    )
    file = tmp_path / "boat.toml"
    file.write_text(f'[boat]\nid = "x"\n[[port]]\nname = "a"\npath = "/dev/a"\n{sensors}', encoding="utf-8")
    if is_right:
        load(file)
        return
    with pytest.raises(SettingsError, match="give both different talkers"):
        load(file)


def test_a_missing_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="cannot be read"):
        load(tmp_path / "none.toml")


def test_the_default_budget_is_four_times_what_the_sensors_send() -> None:
    config = load(EXAMPLE)
    budgets = {port.name: byte_budget(port, config) for port in config.port}
    assert budgets == {"gps": 2000, "imu": 4 * 160 * 20, "compass": 4 * 80 * 10}
