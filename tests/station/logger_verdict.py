"""What an import by the guessed mapping makes of a table, beside the voyage that the table was made from."""

from pathlib import Path
from typing import NamedTuple

from common.angles import difference_deg
from common.errors import WayfixError
from common.framer import ImuSample, Measurement
from common.messages import Fix, Heading, TurnRate
from common.units import NS_PER_S
from shore.imports.column_map import read_column_map
from shore.imports.columns import ColumnReader
from shore.imports.guess import proposed
from tests.station.logger_voyage import Row, Table

_DEG_M = 111_195.0
NOW_S = 1_798_000_000.0
"""In December 2026."""


class Verdict(NamedTuple):
    """`read`, `asked`, `refused` or `wrong`, and what was said or is wrong."""

    kind: str
    words: str
    text: str = ""
    """The proposal."""
    answered: tuple[str, ...] = ()
    """The proposal with each answer to its questions."""


def verdict(table: Table, directory: Path) -> Verdict:
    """What happens to a table: wrong data or a part that is missing is `wrong`."""
    path = directory / table.name
    path.write_bytes(table.data())
    try:
        proposal = proposed(path, NOW_S)
    except WayfixError as refusal:
        return Verdict("refused", str(refusal))
    text = proposal.text()
    if proposal.questions:
        answers = [answer for _, lines in proposal.questions.values() for answer in lines]
        return Verdict("asked", str(proposal.questions), text, tuple(text.replace(f"# {it}", it) for it in answers))
    (directory / "map.toml").write_text(text, encoding="utf-8")
    try:
        reader = ColumnReader(path, read_column_map(directory / "map.toml"))
        records = list(reader.records())
        found = [each for record in records for each in reader.measure(record, record.t_ns or 0)]
    except WayfixError as refusal:
        return Verdict("refused", str(refusal), text)
    too_little = [words for account in reader.accounts if (words := account.too_little()) is not None]
    if too_little:
        return Verdict("refused", str(too_little), text)
    wrong = list(dict.fromkeys(_wrong(table, found, is_utc=reader.is_utc)))
    return Verdict("wrong" if wrong else "read", "; ".join(wrong[:6]), text)


def _wrong(table: Table, found: list[Measurement], *, is_utc: bool) -> list[str]:
    truth = table.truth
    wrong = []
    if is_utc != table.has_utc:
        wrong.append(f"UTC is {'claimed' if is_utc else 'not taken'}")
    zero_ns = truth[0].t.timestamp() * NS_PER_S - (0 if is_utc else min(each.t_ns for each in found) if found else 0)
    parts = set[str]()
    for each in found:
        second = (each.t_ns + (0 if is_utc else zero_ns)) / NS_PER_S - truth[0].t.timestamp()
        k = round(second)
        if not 0 <= k < len(truth) or abs(second - k) > 0.02:
            wrong.append("time")
            continue
        wrong += _of(each, truth[k], parts, magnetic=table.magnetic)
    missing = set(table.parts.split()) - parts
    if missing:
        wrong.append(f"missing: {' '.join(sorted(missing))}")
    fixes = sum(isinstance(each, Fix) for each in found)
    if "fix" in parts and fixes < 0.9 * len(truth):
        wrong.append(f"{fixes} fixes")
    return wrong


def _of(found: Measurement, row: Row, parts: set[str], *, magnetic: bool) -> list[str]:
    wrong = []
    if isinstance(found, Fix):
        parts.add("fix")
        assert found.lat_deg is not None
        assert found.lon_deg is not None
        off_m = _DEG_M * max(abs(found.lat_deg - row.lat_deg), abs(found.lon_deg - row.lon_deg))
        if off_m > 1.0:
            wrong.append("place")
        if found.sog_kn is not None:
            parts.add("sog")
            if abs(found.sog_kn - row.kn) > 0.05:
                wrong.append("sog")
        if found.cog_true_deg is not None:
            parts.add("cog")
            if abs(difference_deg(found.cog_true_deg, row.cog)) > 0.2:
                wrong.append("cog")
    elif isinstance(found, Heading):
        parts.add("heading")
        heading = found.heading_mag_deg if found.heading_true_deg is None else found.heading_true_deg
        if heading is None or (magnetic and found.heading_mag_deg is None):
            wrong.append("which north")
        elif abs(difference_deg(heading, row.cog)) > 0.2:
            wrong.append("heading")
    elif isinstance(found, ImuSample | TurnRate):
        parts.add("imu")
        rate = found.yaw_rate_deg_s if isinstance(found, ImuSample) else found.rate_deg_s
        if rate is not None and abs(rate - row.rate) > 0.1:
            wrong.append("yaw rate")
    return wrong
