"""The virtual boat's boat.toml: the configuration of a daemon, under a first line by which it is known later."""

from pathlib import Path
from typing import Final

from common.boat_config import BoatConfig
from common.settings import as_dict
from common.toml_text import toml_text

WRITTEN_BY: Final = "# Written by `wayfix-onboard virtual`"


def config_text(head: str, config: BoatConfig) -> str:
    """`config` as TOML, every key that has a value written out; head: what it is for, one or more lines."""
    first, *more = head.splitlines()
    comments = "".join(f"# {line}\n" for line in more)
    return f"{WRITTEN_BY} {first}\n{comments}{toml_text(as_dict(config))}"


def is_ours(path: Path) -> bool:
    """Whether the file was written by a virtual boat. Raises OSError."""
    return path.is_file() and path.read_bytes().startswith(WRITTEN_BY.encode())
