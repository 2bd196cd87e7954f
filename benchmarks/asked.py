"""Figures beside what is asked of them (acceptance criteria): one line a run, as text or as a record."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure and what is asked of it."""

    name: str
    value: float | None
    most: float | None = None
    least: float | None = None
    may_lack: bool = False
    """Is no figure at all as right as a good one?"""

    @property
    def ask(self) -> str:
        """The ask in words, "" = none."""
        if self.most is not None:
            return f"<={self.most:g}"
        return "" if self.least is None else f">={self.least:g}"

    @property
    def ok(self) -> bool:
        """Does it hold, where something is asked?"""
        if self.value is None:
            return not self.ask or self.may_lack
        return (self.most is None or self.value <= self.most) and (self.least is None or self.value >= self.least)

    def __str__(self) -> str:
        value = "none" if self.value is None else f"{self.value:.3f}"
        return f"{value:>8}{self.ask:<6}"


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a row."""

    run: str
    figures: tuple[Figure, ...]
    note: str = ""

    @property
    def verdict(self) -> str:
        """Ok, or -, or nothing where nothing is asked."""
        asked = [figure for figure in self.figures if figure.ask]
        return "" if not asked else "ok" if all(figure.ok for figure in asked) else "-"

    def record(self) -> dict[str, Any]:
        """The same for `--json`."""
        figures = {figure.name: figure.value for figure in self.figures}
        asks = {figure.name: figure.ask for figure in self.figures if figure.ask}
        return {"run": self.run, "figures": figures, "asks": asks, "verdict": self.verdict, "note": self.note}


def ratio(above: float | None, below: float | None) -> float | None:
    """Their quotient, where there is one."""
    return above / below if above is not None and below else None


def notes(*words: str) -> str:
    """What is to be said, without what is empty."""
    return "; ".join(word for word in words if word)


def median(values: Sequence[float | None]) -> float | None:
    """Of those that are there."""
    found = [value for value in values if value is not None]
    return statistics.median(found) if found else None
