"""Fault injection, its grammar: `compass2 step 30 deg at 120 s for 60 s`, one sentence for virtual boat and replay.

    SENSOR KIND [SIZE [UNIT]] [toward DEG] at T s [for D s]

`T` counts from the start of the voyage or of the log; without `for` the fault stays. The unit says which quantity is
meant: `gps1 step 50 m` moves the place, `gps1 step 2 m/s` the velocity.
"""

import re
from dataclasses import dataclass
from math import inf, isfinite
from typing import Final

from common.errors import WayfixError
from common.words import did_you_mean

LARGEST: Final = 1e6
"""Largest size, in its unit."""
EXAMPLE: Final = "compass2 step 30 deg at 120 s for 60 s"

PLACE: Final = "place"
VELOCITY: Final = "velocity"
HEADING: Final = "heading"
TURN_RATE: Final = "turn rate"
ACCELERATION: Final = "acceleration"

SIZES: Final = {"m": PLACE, "m/s": VELOCITY, "deg": HEADING, "deg/s": TURN_RATE, "m/s2": ACCELERATION}
"""Which quantity a size in this unit changes."""
SLOPES: Final = {"m/s": PLACE, "m/s2": VELOCITY, "deg/s": HEADING, "deg/s2": TURN_RATE, "m/s3": ACCELERATION}
"""Which quantity a growth in this unit, each second, changes."""
QUANTITIES: Final = {
    "gps": (PLACE, VELOCITY),
    "compass": (HEADING,),
    "gyro": (TURN_RATE,),
    "imu": (TURN_RATE, ACCELERATION),
}
"""Quantities of a reading by the role of its sensor."""
SECONDS: Final = {"s": ""}
"""The size is a time, and changes no single quantity."""
NUMBER: Final = {"": ""}
"""The size is a bare number."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of fault as its sentence is written; what it does stands in `faults.py`."""

    text: str
    roles: tuple[str, ...] = tuple(QUANTITIES)
    units: dict[str, str] | None = None
    """Unit of the size -> quantity; `None` = no size is given."""
    takes_factor: bool = False
    """Whether the size may be a factor instead: `x10`."""


KINDS: Final = {
    "spike": Kind("one reading is off by SIZE", units=SIZES),
    "step": Kind("off by SIZE", units=SIZES),
    "ramp": Kind("off by SIZE more each second; a receiver's velocity stays true", units=SLOPES),
    "carry-off": Kind("the place drifts by SIZE each second, and the velocity says so", ("gps",), {"m/s": PLACE}),
    "noise": Kind(
        "more noise: `x10` of the 1-sigma in the boat's file, or SIZE (1-sigma) on top", units=SIZES, takes_factor=True
    ),
    "stuck": Kind("the last reading again and again"),
    "repeat": Kind("each reading SIZE times: a value that is older than it says", units=NUMBER),
    "zero": Kind("all numbers are 0"),
    "dropout": Kind("no readings"),
    "delay": Kind("the values of SIZE seconds ago", units=SECONDS),
    "clock": Kind("the receiver's UTC is SIZE seconds ahead", ("gps",), SECONDS),
    "claim": Kind("fix quality SIZE as in GGA, whatever the fix is worth", ("gps",), NUMBER),
    "sign": Kind("the other sign: yaw rate, or heading anticlockwise", ("imu", "gyro", "compass")),
    "unit": Kind("radians for degrees; of a receiver m/s for knots"),
    "turned": Kind("its forward axis points SIZE deg to starboard of the bow", ("imu",), {"deg": ""}),
    "upside-down": Kind("it lies on its back, its forward axis to the bow", ("imu",)),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorFault:
    """One fault of one sensor."""

    sensor: str
    kind: str
    size: float = 0.0
    """How large it is, in `unit`; a factor on the stated noise where `is_factor`."""
    unit: str = ""
    is_factor: bool = False
    toward_deg: float = 45.0
    """Direction of a change of place or velocity, deg from north, clockwise."""
    from_s: float
    for_s: float = inf

    @property
    def quantity(self) -> str:
        """What it changes, as its unit says; empty = all of the reading."""
        return (KINDS[self.kind].units or {}).get(self.unit, "")

    def covers(self, t_s: float) -> bool:
        """Whether the fault is there at a time, s."""
        return self.from_s <= t_s < self.from_s + self.for_s


_SENTENCE: Final = re.compile(
    r"(?P<sensor>\S+)\s+(?P<kind>\S+)"
    r"(?:\s+(?P<factor>x)?(?P<size>[-+]?[\d.]+)\s*(?P<unit>[a-z]\S*?)?)??"
    r"(?:\s+toward\s+(?P<toward>[-+]?[\d.]+)(?:\s*deg)?)?"
    r"\s+at\s+(?P<at>[\d.]+)\s*s(?:\s+for\s+(?P<for>[\d.]+)\s*s)?"
)


def fault_of(text: str, roles: dict[str, str], where: str = "--inject") -> SensorFault:
    """The fault that a sentence names; `roles` = role of each sensor of the boat by its id.

    Raises WayfixError that says which word is wrong.
    """
    found = _SENTENCE.fullmatch(text.strip())
    if found is None:
        cure = f"write SENSOR KIND [SIZE UNIT] [toward DEG] at T s [for D s], for example {EXAMPLE!r}"
        raise WayfixError(f"{text!r} is not understood", where, cure)
    sensor, kind = found["sensor"], found["kind"]
    if sensor not in roles:
        what = f"the boat has no sensor {sensor!r}{did_you_mean(sensor, roles)}"
        raise WayfixError(what, where, f"choose one of: {', '.join(roles)}")
    if kind not in KINDS:
        what = f"there is no fault {kind!r}{did_you_mean(kind, KINDS)}"
        raise WayfixError(what, where, f"choose one of: {', '.join(KINDS)}")
    if roles[sensor] not in KINDS[kind].roles:
        what = f"{kind} is for {', '.join(KINDS[kind].roles)}; {sensor} is a {roles[sensor]}"
        raise WayfixError(what, where, "choose another sensor or fault")
    fault = SensorFault(
        sensor=sensor,
        kind=kind,
        size=_number(found["size"] or "0", where),
        unit=found["unit"] or "",
        is_factor=found["factor"] is not None,
        toward_deg=_number(found["toward"] or "45", where),
        from_s=_number(found["at"], where),
        for_s=_number(found["for"], where) if found["for"] else inf,
    )
    _check_size(fault, roles[sensor], found["size"] is not None, where)
    return fault


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = inf
    if not isfinite(value):
        raise WayfixError(f"{text!r} is no number", where, f"write it as in {EXAMPLE!r}")
    return value


def _check_size(fault: SensorFault, role: str, is_given: bool, where: str) -> None:
    """Refuse a size that is missing, too much, or of a quantity that the sensor does not measure."""
    kind = KINDS[fault.kind]
    if kind.units is None:
        if is_given:
            raise WayfixError(f"{fault.kind} takes no size", where, f"write `{fault.sensor} {fault.kind} at T s`")
        return
    fitting = [unit for unit, quantity in kind.units.items() if quantity in (*QUANTITIES[role], "")]
    if not is_given or (fault.unit not in fitting and not (fault.is_factor and kind.takes_factor)):
        units = ", ".join(f"a number of {unit}" if unit else "a number" for unit in fitting)
        factor = ", or a factor as in x10" if kind.takes_factor else ""
        raise WayfixError(f"{fault.kind} of a {role} needs {units}{factor}", where, f"for example {EXAMPLE!r}")
    if fault.is_factor and (not kind.takes_factor or fault.size < 1.0 or fault.unit):
        raise WayfixError(
            f"x{fault.size:g} does not fit {fault.kind}", where, "give noise a factor of 1 or more, as x10"
        )
    if abs(fault.size) > LARGEST:
        raise WayfixError(f"{fault.kind} of {fault.size:g} is too much", where, f"give at most {LARGEST:g}")
    if fault.kind in ("repeat", "claim") and (fault.size != int(fault.size) or not 0 <= fault.size <= 9):
        raise WayfixError(f"{fault.kind} needs a whole number, got {fault.size:g}", where, "give 0 to 9")
