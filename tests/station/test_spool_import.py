"""Frames exported from the board's spool become a log ashore."""

from pathlib import Path

import pytest

from common.codec import encode_frame
from common.messages import Fix, Frame
from onboard.journal import Journal
from onboard.main import main
from onboard.spool import Spool
from tests.link.spooling import QUICK, Told, identity
from tests.station.imports import Importer

UTC_NS = 1_795_000_000 * 10**9
ABOUT = {
    "config": {
        "boat": {"id": "springer"},
        "port": [{"name": "gps", "path": "/dev/ttyUSB0"}],
        "sensor": [{"id": "gps1", "port": "gps", "role": "gps"}],
    },
    "versions": {"wayfix": "0"},
}


def test_an_export_is_imported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    who = identity()
    spool = Spool(tmp_path / "spool", who, QUICK, Journal(Told(), lambda: 0), about=ABOUT)
    for seq in range(50):
        t0_ns = 10**12 + seq * 10**9
        fix = Fix(sensor="gps1", t_ns=t0_ns, lat_deg=50.0 + 1e-5 * seq, lon_deg=-1.0, fix_quality=1)
        frame = Frame(
            boat_id=who.boat_id,
            boot_id=who.boot_id,
            seq=seq,
            clock_id=who.clock_id,
            start_no=who.start_no,
            t0_ns=t0_ns,
            t1_ns=t0_ns + 10**9,
            utc_ns=UTC_NS + seq * 10**9,
            utc_src="gnss",
            fixes=(fix,),
        )
        spool.append(seq, encode_frame(frame))
    spool.close(10.0)
    out = tmp_path / "out.frames"
    assert main(["spool", "export", str(out), "--state", str(tmp_path)]) == 0
    imported = Importer(tmp_path, capsys)(out)
    assert [frame.seq for frame in imported.frames] == list(range(50))
    assert imported.frames[0].boot_id == who.boot_id
    assert len(imported.fixes) == 50
