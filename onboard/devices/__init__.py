"""Device drivers: lines of a port become typed measurements. Beside each stands an encoder that prints such lines.

Every line ends as Accepted, Rejected (with a reason) or Ignored; nothing here raises on bad input, reads a clock or
opens anything.
"""

from onboard.devices.driver import Accepted, Driver, Ignored, Line, Outcome, Rejected
from onboard.devices.encoder import Encoder, Surroundings
from onboard.devices.port_decoder import PortDecoder
from onboard.devices.recognise import recognised
from onboard.devices.registry import MODELS, make_driver, make_encoder

__all__ = [
    "MODELS",
    "Accepted",
    "Driver",
    "Encoder",
    "Ignored",
    "Line",
    "Outcome",
    "PortDecoder",
    "Rejected",
    "Surroundings",
    "make_driver",
    "make_encoder",
    "recognised",
]
