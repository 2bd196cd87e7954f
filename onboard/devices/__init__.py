"""Device drivers: lines of a port become typed measurements, one file for each device family.

Every line ends as Accepted, Rejected (with a reason) or Ignored; nothing here raises on bad input, reads a clock or
opens anything.
"""

from onboard.devices.driver import Accepted, Driver, Ignored, Line, Outcome, Rejected
from onboard.devices.port_decoder import PortDecoder
from onboard.devices.recognise import recognised
from onboard.devices.registry import MODELS, make_driver

__all__ = [
    "MODELS",
    "Accepted",
    "Driver",
    "Ignored",
    "Line",
    "Outcome",
    "PortDecoder",
    "Rejected",
    "make_driver",
    "recognised",
]
