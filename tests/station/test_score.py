import math
from pathlib import Path

import pytest

from common.errors import WayfixError
from common.units import NS_PER_S
from shore.score import read_reference

HEAD = "t_s,lat_deg,lon_deg,heading_true_deg\n"


def reference(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "reference.csv"
    file.write_bytes(text.encode())
    return file


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "has 0 rows"),
        (HEAD + "0,1,1,1\n", "has 1 rows"),
        ("t_s,lat,lon,h\n0,1,1,1\n1,1,1,1\n", "has no column lat_deg, lon_deg, heading_true_deg"),
        (HEAD + "0,1,1,1\n1,nan,1,1\n", "line 3: lat_deg cannot be 'nan'"),
        (HEAD + "0,1,1,1\n1,inf,1,1\n", "line 3: lat_deg cannot be 'inf'"),
        (HEAD + "0,95,1,1\n1,1,1,1\n", "line 2: lat_deg cannot be '95'"),
        (HEAD + "0,1,1,1\n1,1,1\n", "line 3: heading_true_deg cannot be None"),
        (HEAD + "1,1,1,1\n0,1,1,1\n", "line 3: time does not grow"),
        (HEAD + "x" * 200_000, "is no CSV text"),
    ],
)
def test_a_reference_that_cannot_be_right_is_one_sentence(tmp_path: Path, text: str, part: str) -> None:
    with pytest.raises(WayfixError) as caught:
        read_reference(reference(tmp_path, text), 0)
    assert part in str(caught.value)
    assert "reference.csv" in str(caught.value)


def test_a_reference_is_interpolated_across_north_and_never_over_a_hole(tmp_path: Path) -> None:
    text = "\ufefft_s, lat_deg, lon_deg, heading_true_deg\n0,50,1,350\n1,50,1,10\n10,50,1,20\n11,50,1,30\n"
    track = read_reference(reference(tmp_path, text), 5 * NS_PER_S)
    middle = track.at(int(5.5 * NS_PER_S))
    assert middle is not None
    assert math.isclose(math.remainder(middle[2], 360.0), 0.0, abs_tol=1e-9)
    assert track.at(10 * NS_PER_S) is None
    assert track.at(4 * NS_PER_S) is None
    assert track.at(17 * NS_PER_S) is None
    assert track.at(int(15.5 * NS_PER_S)) is not None
