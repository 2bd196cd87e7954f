"""Schema validation: a dict becomes frozen dataclasses; keys, types and ranges are checked, all faults said at once.

    config = read_toml("boat.toml", BoatConfig)
    SettingsError: boat.toml: [[sensor]] gps1.rate_hz: must be >= 0.01, got -1

Types understood: str, int, float (an int is taken for a float), bool, nested dataclasses, `tuple[X, ...]`, `X | None`,
each with `Annotated` bounds of `common.field_bounds`.
"""

import dataclasses
import math
import tomllib
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin

from common.errors import SettingsError
from common.field_bounds import MaxLength, NeededFor, OneOf, OnlyFor, Range, SomeOnce
from common.words import did_you_mean

T = TypeVar("T")

_TYPE_WORDS = {str: "a text", int: "a whole number", float: "a number", bool: "true or false"}


def read_toml(path: str | Path, table: type[T], use: str | None = None) -> T:
    """Read a TOML file into the frozen dataclass `table`; raises SettingsError with every fault found.

    use: of a file that several programs read, see `OnlyFor` and `NeededFor` of `common.field_bounds`.
    """
    return convert(load_toml(path), table, str(path), use=use)


def load_toml(path: str | Path) -> dict[str, Any]:
    """A TOML file as it is, with or without a byte order mark; raises SettingsError."""
    file = str(path)
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise SettingsError(file, [f"cannot be read ({error.strerror})"], "give the path of a readable file") from error
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        what = f"is not valid TOML: byte 0x{error.object[error.start]:02x} in line {line} is no UTF-8"
        raise SettingsError(file, [what], "save it as UTF-8") from error
    except RecursionError as error:
        raise SettingsError(file, ["is not valid TOML: it is nested too deeply"]) from error
    except ValueError as error:  # TOMLDecodeError, and what Python says of a whole number of thousands of digits
        raise SettingsError(file, [f"is not valid TOML: {error}"]) from error


def convert(
    data: Mapping[str, Any], table: type[T], file: str = "settings", *, strict: bool = True, use: str | None = None
) -> T:
    """Turn nested dicts (TOML, or the wire's config map) into `table`; raises SettingsError with every fault found.

    Not strict: unknown keys are passed over, as a newer board or log may have them.
    """
    faults: list[str] = []
    value = _table(data if strict else _known(data, table), table, "", faults, use)
    if faults:
        raise SettingsError(file, faults)
    return typing.cast("T", value)


def _known(data: Any, hint: Any) -> Any:
    """`data` without the keys that the tables of `hint` do not know."""
    if get_origin(hint) is Annotated:
        hint = get_args(hint)[0]
    if get_origin(hint) is tuple and isinstance(data, list | tuple):
        return [_known(item, get_args(hint)[0]) for item in data]
    if not dataclasses.is_dataclass(hint) or not isinstance(data, Mapping):
        return data
    hints = typing.get_type_hints(hint, include_extras=True)
    return {key: _known(item, hints[key]) for key, item in data.items() if key in hints}


def as_dict(value: Any) -> Any:
    """The reverse of `convert`: plain dicts and lists, `None` left out, fit for MessagePack, JSON and TOML."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        pairs = ((field.name, getattr(value, field.name)) for field in dataclasses.fields(value))
        return {name: as_dict(item) for name, item in pairs if item is not None}
    if isinstance(value, tuple | list):
        return [as_dict(item) for item in value]
    return value


def _table(data: Any, table: type, where: str, faults: list[str], use: str | None) -> Any:
    if not isinstance(data, Mapping):
        faults.append(f"{where or 'top level'}: must be a table")
        return None
    hints = _hints(table, use)
    for key in data:
        if key not in hints:
            hint = did_you_mean(str(key), hints) or f" (known: {', '.join(hints)})"
            faults.append(f"{_join(where, key)}: unknown key{hint}")
    values = {}
    for field in dataclasses.fields(table):
        if field.name not in hints:
            continue
        hint = hints[field.name]
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if field.name in data:
            values[field.name] = _value(data[field.name], hint, _join(where, field.name), faults, use)
        elif required or use in _uses(hint, NeededFor):
            faults.append(f"{_join(where, field.name)}: missing")
    if faults:
        return None
    return table(**values)


def _hints(table: type, use: str | None) -> dict[str, Any]:
    """The keys that `use` knows, and their types."""
    hints = typing.get_type_hints(table, include_extras=True)
    return {name: hint for name, hint in hints.items() if all(only == use for only in _uses(hint, OnlyFor))}


def _uses(hint: Any, mark: type[OnlyFor | NeededFor]) -> list[str]:
    bounds = get_args(hint)[1:] if get_origin(hint) is Annotated else ()
    return [bound.use for bound in bounds if isinstance(bound, mark)]


def _value(value: Any, hint: Any, where: str, faults: list[str], use: str | None) -> Any:
    bounds: tuple[Any, ...] = ()
    if get_origin(hint) is Annotated:
        hint, *rest = get_args(hint)
        bounds = tuple(rest)
    if get_origin(hint) in (typing.Union, types.UnionType):
        return _value(value, next(arm for arm in get_args(hint) if arm is not type(None)), where, faults, use)
    if get_origin(hint) is tuple:
        items = _list(value, get_args(hint)[0], where, faults, use)
        if isinstance(value, list | tuple) and (fault := _bound_fault(value, bounds)):
            faults.append(f"{where}: {fault}")
        return items
    if dataclasses.is_dataclass(hint):
        return _table(value, typing.cast("type", hint), where, faults, use)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        value = _float(value)
    if not isinstance(value, hint) or (isinstance(value, bool) and hint is not bool):
        faults.append(f"{where}: must be {_TYPE_WORDS[hint]}, got {value!r}")
        return None
    fault = _bound_fault(value, bounds)
    if fault:
        faults.append(f"{where}: {fault}")
    return value


def _float(value: int) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _list(value: Any, item_hint: Any, where: str, faults: list[str], use: str | None) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        faults.append(f"{where}: must be a list, got {value!r}")
        return ()
    items = []
    for number, item in enumerate(value, 1):
        # Each entry is checked apart, so that one broken sensor does not hide the faults of the next.
        inner: list[str] = []
        items.append(_value(item, item_hint, _entry(where, item, number), inner, use))
        faults.extend(inner)
    return tuple(items)


def _bound_fault(value: Any, bounds: tuple[Any, ...]) -> str | None:
    if isinstance(value, float) and not math.isfinite(value):
        return f"must be finite, got {value}"
    for bound in bounds:
        if isinstance(bound, Range) and (fault := bound.fault(value)):
            return fault
        if isinstance(bound, OneOf) and value not in bound.choices:
            return f"must be one of {', '.join(bound.choices)}, got {value!r}"
        if isinstance(bound, SomeOnce) and (fault := _once_fault(value)):
            return fault
        if isinstance(bound, MaxLength) and len(value) > bound.count:
            return f"must be at most {bound.count} characters, got {len(value)}"
        if isinstance(bound, MaxLength) and isinstance(value, str) and not value.isprintable():
            return f"has a character that cannot be shown: {value!a}"
    return None


def _once_fault(items: Sequence[object]) -> str | None:
    if not items:
        return "must hold at least one"
    twice = next((item for number, item in enumerate(items) if item in items[:number]), None)
    return None if twice is None else f"holds {twice!r} twice"


def _entry(where: str, item: Any, number: int) -> str:
    """Entries of `[[sensor]]` and `[[port]]` are named by their id or name, others by their number."""
    name = None
    if isinstance(item, Mapping):
        name = item.get("id") or item.get("name")
        return f"[[{where}]] {name if isinstance(name, str) and name.isprintable() else number}"
    return f"{where}[{number}]"


def _join(where: str, key: object) -> str:
    name = str(key) if str(key).isprintable() else repr(key)
    return f"{where}.{name}" if where else name
