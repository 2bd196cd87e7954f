"""NMEA compasses as encoders (sensor simulation): any of them, Digital Yacht HSC100, Honeywell HMR3000.

They measure from magnetic north and know no variation. So HDG is the heading that is sent, with deviation and variation
empty; HDT would repeat it under a wrong name.
"""

from typing import TYPE_CHECKING

from common.angles import wrap_deg
from common.boat_config import SensorTable
from onboard.devices.encoder import Surroundings, fixed, sealed

if TYPE_CHECKING:
    from common.simulation.readings import HeadingReading


class CompassEncoder:
    """`$HCHDG,123.4,,,,*46`, then ROT and XDR where the reading has it. The talker is the table's first, else HC."""

    def __init__(self, table: SensorTable, around: Surroundings) -> None:
        self._variation_deg = around.variation_deg
        self._talker = table.talkers[0] if table.talkers else "HC"

    def encode(self, t_s: float, reading: "HeadingReading") -> bytes:  # noqa: ARG002  part of the Encoder interface
        """HDG; ROT in deg/min; XDR with PITCH and ROLL in deg, each to a tenth."""
        data = self.heading_sentence(reading)
        if reading.turn_rate_deg_s is not None:
            data += sealed(f"{self._talker}ROT,{fixed(60.0 * reading.turn_rate_deg_s, 1)},A")
        angles = (("PITCH", reading.pitch_deg), ("ROLL", reading.roll_deg))
        groups = "".join(f",A,{fixed(value, 1)},D,{name}" for name, value in angles if value is not None)
        return data + sealed(f"{self._talker}XDR{groups}") if groups else data

    def heading_sentence(self, reading: "HeadingReading") -> bytes:
        """HDG alone: three digits before the point, and as many decimals as the reading asks for."""
        decimals = reading.decimals
        width = 4 + decimals if decimals else 3
        heading = f"{magnetic_deg(reading, self._variation_deg, decimals):0{width}.{decimals}f}"
        return sealed(f"{self._talker}HDG,{heading},,,,")


class Hsc100Encoder:
    """`$HCHDG,123.4,,,,*46`, like an HSC100: nothing but HDG, whatever else the reading holds."""

    def __init__(self, table: SensorTable, around: Surroundings) -> None:
        self._compass = CompassEncoder(table, around)

    def encode(self, t_s: float, reading: "HeadingReading") -> bytes:  # noqa: ARG002  part of the Encoder interface
        """One HDG sentence."""
        return self._compass.heading_sentence(reading)


class Hmr3000Encoder:
    """`$PTNTHPR,354.9,N,5.2,N,0.2,N*3A`.

    A disturbed field is the letter O of the heading: the total field lies between the limits of warning and alarm, as
    beside iron (user's guide of the HMR3000, 3.12); the heading is still sent.
    """

    def __init__(self, table: SensorTable, around: Surroundings) -> None:  # noqa: ARG002  its sentence has no talker
        self._variation_deg = around.variation_deg

    def encode(self, t_s: float, reading: "HeadingReading") -> bytes:  # noqa: ARG002  part of the Encoder interface
        """One HPR sentence, degrees to a tenth: without a decimal they would be mils."""
        heading = fixed(magnetic_deg(reading, self._variation_deg), 1)
        letter = "O" if reading.disturbed else "N"
        return sealed(f"PTNTHPR,{heading},{letter},{fixed(reading.pitch_deg, 1)},N,{fixed(reading.roll_deg, 1)},N")


def magnetic_deg(reading: "HeadingReading", variation_deg: float, finest: int = 1) -> float:
    """The heading from magnetic north in [0, 360), deg, rounded as the device does: to `finest` decimals at most."""
    decimals = min(reading.decimals, finest)
    return wrap_deg(round(wrap_deg(reading.heading_true_deg - variation_deg), decimals))
