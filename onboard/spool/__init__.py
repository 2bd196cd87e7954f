"""Store and forward: the board's durable store of frames (docs/spool-format.md)."""

from onboard.spool.memory import Batch
from onboard.spool.shelf import Run
from onboard.spool.store import Spool

__all__ = ["Batch", "Run", "Spool"]
