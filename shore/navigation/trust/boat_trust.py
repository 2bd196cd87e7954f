"""What a filter of a real boat does around each prediction and update: it weighs its sensors (fault-tolerant fusion).

A filter asks what drives a prediction and how a measurement is to be fused; all that is remembered is one immutable
`Trust` in the filter's state (`memory.py`).

prediction  the axes of the IMU that are in use; process noise by what they do not explain; each second the water
fix         what the receiver claims, a lasting error as a state, its velocity behind a guard, then axes and turns
compass     its deviation as states, a larger R in turns; set aside by the witnesses of a turn, and taken back
"""

from shore.navigation.measurements import Course, Measurement, Position, TrueHeading
from shore.navigation.trust.fixes import fuse_fix
from shore.navigation.trust.headings import fuse_heading
from shore.navigation.trust.memory import Engine, Regard, Vessel
from shore.navigation.trust.opening import start_again_when_due
from shore.navigation.trust.water import EVERY_S, known_water


def before_prediction(boat: Vessel, engine: Engine) -> None:
    """What the water says, once a second, of a state that something was measured in.

    Before the next prediction, not after one: what is shown between two measurements does not depend on when that is.
    """
    pending_s = engine.trust.way.pending_s
    if pending_s >= EVERY_S:
        known_water(boat, engine, pending_s)


def fuse(boat: Vessel, engine: Engine, measured: Measurement) -> None:
    """Fuse one measurement."""
    trust = engine.trust
    if trust.started_ns is None:
        engine.remember(trust._replace(started_ns=measured.t_ns))
    if isinstance(measured, Position):
        fuse_fix(boat, engine, measured)
        start_again_when_due(boat, engine, measured.sensor)
    elif isinstance(measured, TrueHeading):
        fuse_heading(boat, engine, measured)
    elif not isinstance(measured, Course):  # the water gives the heading of a boat without compass
        engine.fuse_parts(measured, [Regard()] * len(measured.parts))
