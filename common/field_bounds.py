"""Bounds of a field (validation), attached with `Annotated`; the codec and the settings reader both obey them."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Range:
    """Closed interval [low, high] in the field's own unit; `None` = unbounded on that side."""

    low: float | None = None
    high: float | None = None

    def fault(self, value: float) -> str | None:
        """Why `value` is out of bounds, or `None`."""
        if self.low is not None and value < self.low:
            return f"must be >= {self.low:g}, got {value:g}"
        if self.high is not None and value > self.high:
            return f"must be <= {self.high:g}, got {value:g}"
        return None


@dataclass(frozen=True, slots=True)
class OneOf:
    """The texts a field may hold."""

    choices: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class MaxLength:
    """The most characters (text) or entries (list) a field may hold."""

    count: int


@dataclass(frozen=True, slots=True)
class SomeOnce:
    """A list of texts that holds at least one, and none twice."""


@dataclass(frozen=True, slots=True)
class OnlyFor:
    """A key of one use of a settings file that several programs read; in every other use it is unknown."""

    use: str


@dataclass(frozen=True, slots=True)
class NeededFor:
    """A key that one use of a settings file cannot do without; every other use takes its default."""

    use: str
