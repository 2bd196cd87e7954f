"""Errata of the thesis: where its text can be read in two ways or contradicts itself, and how we read it."""

from typing import Final, NamedTuple


class Reading(NamedTuple):
    """One place of the thesis that can be read in two ways."""

    where: str
    """Equation, table, figure or section of the thesis."""
    doubt: str
    """What is unclear in the text, or contradicts itself."""
    ours: str
    """How the text is read in this program."""


READINGS: Final = (
    Reading(
        "Tables 3.4, 4.4, 5.4",
        "numbers under “variance” carry the units of a deviation (8 m, 0.036 °/s)",
        "1-sigma; the raw MSEs of 64 and 49 m² confirm it",
    ),
    Reading(
        "Table 3.4",
        "scanned as 0.0042 m/s²",
        "0.004 squared: 1-sigma of 0.004 m/s²",
    ),
    Reading(
        "Eq. 4.29, Table 4.1",
        "Q from q squared, as printed, gives errors half as large as published",
        "<b>stated</b>: q squared. <b>compat</b>: q in the place of q squared, which explains most published figures. "
        "Some 30 readings were tried against 42 numbers: compat is the best explanation found, no proof",
    ),
    Reading(
        "Section 4.3.3",
        "“the same noise models as Table 4.1” while the sensors have Table 4.4",
        "<b>stated</b>: Table 4.1. <b>compat</b>: R of the true noise; only this fits the published figures",
    ),
    Reading(
        "Sections 4.2.3, 4.3.3",
        "is the first state exact?",
        "<b>stated</b>: drawn from P(1). <b>compat</b>: exact; the errors are 3-9 % lower",
    ),
    Reading(
        "Scenarios 4.1, 4.2",
        "the text names the noise of Table 3.4 (8 and 7 m), the raw MSEs are 6 to 10 m²",
        "3 m, 2.5 m, 0.5° of Table 4.1",
    ),
    Reading(
        "Eq. 4.28",
        "the rotation is printed for x = North; the axes are x = East, y = North",
        "its transpose for a clockwise heading: a_east = sin ψ a_fwd + cos ψ a_stb",
    ),
    Reading(
        "Eqs 4.40, 4.41",
        "the velocity turns anticlockwise for w > 0 while the heading grows",
        "the heading turns with the velocity",
    ),
    Reading("Eq. 4.22", "T² or T²/2 before the acceleration", "T²/2, which fits Eq. 4.29; the difference is below 3 %"),
    Reading(
        "Section 4.3.3, turn rule",
        "a boat on course always turns clockwise first",
        "dead band of wT, difference wrapped; turn rate 3 °/s and clearance 20 m are ours",
    ),
    Reading(
        "Figs 4.14, 4.18", "currents are shown as pictures only", "towards 140°; towards 235° + 45° sin(2π x / 800 m)"
    ),
    Reading("Section 5.1.1", "no window N is given", "30 for the literal rule"),
    Reading("Eq. 5.4", "lacks the factor 1/N of Eq. 5.3", "1/N kept"),
    Reading("Eq. 5.9", "P before the update", "P after it, as residuals ask for; no visible difference here"),
    Reading(
        "Eq. 5.11",
        "R(k) on both sides",
        "R(k) = a R(k-1), limited: with R0 on the right the compass of Scenario 5.2 could never be learned",
    ),
    Reading("Eqs 5.19-5.23", "the cases do not meet", "taken literally: a jumps at 0.75, 0.85, 1.15 and 1.25"),
    Reading(
        "Table 5.5",
        "adaptive heading 0.0011 °², text 0.4989 and 0.2288 m²",
        "below the bound, so impossible; the text's figures contradict the table's 4.08 and 2.55",
    ),
    Reading(
        "Table 5.7", "raw rows of the change at 300 s", "they cover the steps after it; the filters' rows the whole run"
    ),
    Reading(
        "Table 5.9",
        "the metres omit cos(latitude)",
        "buoys at (184.2, 159.3), (276.6, 463.9), (24.0, 390.1) m from the printed latitudes and longitudes",
    ),
)
