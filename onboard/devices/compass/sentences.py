"""Sentences of compasses as typed readings: HDG, HDM, HDT."""

from dataclasses import dataclass
from typing import Final

from onboard.devices import fields
from onboard.devices.nmea import Form, Text


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingReading:
    """HDG and HDM (magnetic) or HDT (true); both headings `None` = the field was empty."""

    heading_mag_deg: float | None = None
    heading_true_deg: float | None = None
    deviation_deg: float | None = None
    """East +."""
    variation_deg: float | None = None
    """East +."""


def _hdg(text: Text) -> HeadingReading:
    return HeadingReading(
        heading_mag_deg=fields.direction(text("heading")),
        deviation_deg=fields.east_positive(text("deviation"), text("dev_dir")),
        variation_deg=fields.east_positive(text("variation"), text("var_dir")),
    )


def _hdm(text: Text) -> HeadingReading:
    fields.letter(text("magnetic"), "M", "unit")
    # KVH: `$HCHDM,123.4,M,*hh` has a comma too many, nothing may follow it.
    fields.letter(text("#2"), "", "fields")
    return HeadingReading(heading_mag_deg=fields.direction(text("heading")))


def _hdt(text: Text) -> HeadingReading:
    # HSC100T: `$HEHDT,123.4*hh` leaves the T out.
    fields.letter(text("hdg_true"), "T", "unit")
    return HeadingReading(heading_true_deg=fields.direction(text("heading")))


FORMS: Final[dict[str, Form[HeadingReading]]] = {
    "HDG": Form(5, 5, _hdg),
    "HDM": Form(1, 3, _hdm),
    "HDT": Form(1, 2, _hdt),
}
