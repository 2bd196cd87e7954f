"""The boat's file (configuration) of a virtual boat: what the daemon would read, and whether it can be simulated."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Final

from common.boat_config import BoatConfig
from common.errors import SettingsError
from onboard.config import load

TAKEN: Final = ("boat.toml", "truth.csv", "sent.jsonl")
"""Names that stand beside the ports."""
_PLAIN: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*")


def virtual_boat(path: Path) -> BoatConfig:
    """Read and check a boat's file; its port names become names in a directory. Raises SettingsError with all faults.

    A file that leaves the variation to the station gets one of 0 here, and its compasses show true headings: what the
    station would reckon for place and date is not known on board.
    """
    config = load(path)
    names = [port.name for port in config.port]
    faults = [
        f"[[port]] {name!r}: a virtual port is a file beside {', '.join(TAKEN)}; use letters, digits, - and _"
        for name in names
        if not _PLAIN.fullmatch(name) or name in TAKEN
    ]
    if faults:
        raise SettingsError(str(path), faults)
    return replace(config, boat=replace(config.boat, variation_deg=config.boat.variation_deg or 0.0))
