"""Configuration directory of the station (XDG base directory): where settings and keys of a person are kept."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from common.errors import WayfixError

FILE: Final = "wayfix.toml"


def config_directory(environ: Mapping[str, str]) -> Path:
    """`$XDG_CONFIG_HOME/wayfix` when that is absolute, else `~/.config/wayfix`. Raises WayfixError without a home."""
    config = Path(environ.get("XDG_CONFIG_HOME", ""))
    if config.is_absolute():
        return config / "wayfix"
    try:
        return Path.home() / ".config" / "wayfix"
    except RuntimeError as error:
        cure = "set HOME, or XDG_CONFIG_HOME to an absolute path"
        raise WayfixError("this user has no home directory", "~/.config/wayfix", cure) from error
