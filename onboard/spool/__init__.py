"""Store and forward: the board's durable store of frames (docs/spool-format.md)."""

from onboard.spool.memory_ring import Batch
from onboard.spool.segment_index import Run
from onboard.spool.store import Spool

__all__ = ["Batch", "Run", "Spool"]
