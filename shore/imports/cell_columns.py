"""Column reader of a table: a cell becomes a number in the boat's unit (unit conversion)."""

import math
import re
from dataclasses import dataclass
from typing import Final

from shore.imports.cells import is_nothing, number_and_unit
from shore.imports.line_counts import Rejected
from shore.imports.units import factor_of
from shore.imports.values import in_range

Cells = dict[str, str]
_NORTH_IS: Final = re.compile(r"(.*?)\s*(t|true|m|mag|magnetic)", re.IGNORECASE)


class BadCell(Rejected):
    """A cell that cannot be right; `where` names column and value."""

    def __init__(self, reason: str, column: str, text: str) -> None:
        super().__init__(reason)
        self.where = f"column {column!r}, value {text[:40]!r}"


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberColumn:
    """A column of numbers, with or without a unit in each cell."""

    name: str
    what: str
    """What a person calls the value."""
    low: float
    high: float
    """Bounds in the boat's unit."""
    decimal: str
    quantity: str | None = None
    """The quantity of `UNITS` whose units a cell may carry."""
    scale: float | None = None
    """Factor that the mapping gives."""
    named: float = 1.0
    """Factor where neither mapping nor cell says one."""
    magnetic: bool | None = None
    """Which north the mapping says, for a direction."""

    def read(self, cells: Cells) -> float | None:
        """The value; `None` = empty; raises BadCell."""
        text = cells[self.name]
        if is_nothing(text):
            return None
        try:
            value, unit = number_and_unit(text, self.decimal)
            return in_range(value * self._factor(unit), self.what, self.low, self.high)
        except Rejected as reason:
            raise BadCell(str(reason), self.name, text) from None

    def _factor(self, unit: str) -> float:
        if self.magnetic is not None and (match := _NORTH_IS.fullmatch(unit)) is not None:
            if match[2][0].casefold() != ("m" if self.magnetic else "t"):
                raise Rejected(f"{self.what}: its letter says the other north than `magnetic` of the mapping")
            unit = match[1]
        if not unit:
            return self.named if self.scale is None else self.scale
        factor = None if self.quantity is None else factor_of(unit, self.quantity)
        if factor is None:
            raise Rejected(f"{self.what}: not a number")
        if self.scale is None:
            return factor
        if not math.isclose(abs(self.scale), factor, rel_tol=1e-3):
            raise Rejected(f"{self.what}: its unit contradicts the scale of the mapping")
        return self.scale
