"""NMEA 0183 parser: sentences to typed readings; the only importer of pynmea2, behind a strict guard.

pynmea2 splits a sentence and names its fields; its converters are not used, because they answer an empty coordinate
with 0.0, a bad number with its text, `nan` with nan, and raise IndexError, TypeError or OverflowError on what a noisy
cable sends. Every value is read by `onboard.devices.nmea_fields` instead. An empty field is `None`, not a fault.

Another sentence = a reading, a function and a row in the `FORMS` of its device family.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

import pynmea2

from onboard.devices.nmea_fields import FieldFault
from onboard.devices.nmea_sentence import Sentence

Reading_co = TypeVar("Reading_co", covariant=True)
Text = Callable[[str], str]
"""Raw text of the field with that name; empty where the sentence ends before it."""


@dataclass(frozen=True, slots=True)
class Form(Generic[Reading_co]):
    """One row of a family's table: how many fields the sentence may have, and who reads them."""

    least: int
    most: int
    read: Callable[[Text], Reading_co]
    names: tuple[str, ...] = ()
    """Names of the fields after the address, for a sentence that pynmea2 does not know (a maker's own); it is split
    here."""
    step: int = 1
    """Number of fields in a group; groups come beyond `least`."""


# Fields that pynmea2 1.15 (Debian 12) has no name for, by place; `#2` marks what no version names.
_PLACES: Final = {"mode_indicator": 11, "#2": 2}


def read(sentence: Sentence, forms: Mapping[str, Form[Reading_co]]) -> Reading_co | str:
    """The reading, or the reason why there is none.

    Reasons: `formatter` (not in `forms`), `fields` (their number; half a position), `not-a-number`, `range`,
    `hemisphere`, `zero-position`, `unit`, `status`, `time`, `date`, `parser` (pynmea2 gave up or broke).
    """
    form = forms.get(sentence.formatter)
    if form is None:
        return "formatter"
    try:
        data, places = _split(sentence, form.names)
        if not form.least <= len(data) <= form.most or (len(data) - form.least) % form.step:
            return "fields"

        def text(name: str) -> str:
            place = places[name] if name in places else _PLACES[name]
            return data[place] if place < len(data) else ""

        return form.read(text)
    except FieldFault as fault:
        return fault.reason
    except Exception:
        return "parser"


def _split(sentence: Sentence, names: tuple[str, ...]) -> tuple[list[str], Mapping[str, int]]:
    """Fields after the address, and the place of each name."""
    if names:
        return sentence.text[:-3].split(",")[1:], {name: place for place, name in enumerate(names)}
    parsed = pynmea2.parse(sentence.text[:-3])  # without the checksum, which is right: it would be worked out again
    return parsed.data, type(parsed).name_to_idx
