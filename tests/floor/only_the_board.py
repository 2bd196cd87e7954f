"""Loaded at the start of every Python of the floor's environment: what a board has not cannot be imported."""

import sys
from typing import Any

ASHORE = {"filterpy", "matplotlib", "mcap", "numpy", "pyais", "pygeomag", "pyproj", "rich", "scipy"}


class NotOnTheBoard:
    """A finder that finds nothing of the station."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> None:
        """Refuse the names of `ASHORE`; every other name is for the next finder."""
        if name.partition(".")[0] in ASHORE:
            raise ModuleNotFoundError(f"No module named {name!r} on the board", name=name)


sys.meta_path.insert(0, NotOnTheBoard)
