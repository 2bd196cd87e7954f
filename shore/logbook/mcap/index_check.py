"""Index consistency: do the head of a chunk and its message indexes agree with its content? Only `verify` asks."""

from shore.logbook.mcap.findings import Findings
from shore.logbook.mcap.record_at import Record
from shore.logbook.mcap.records import HEAD, ChunkHead, Message, index_entries, index_of


class IndexCheck:
    """Feed it each sound chunk and the indexes that follow; what differs becomes a flaw of the findings."""

    def __init__(self, findings: Findings) -> None:
        self._findings = findings
        self._entries: dict[int, list[tuple[int, int]]] = {}
        """Entries that the indexes behind the last chunk should have, by channel."""

    def chunk(self, record: Record, head: ChunkHead, data: bytes, messages: list[Message]) -> None:
        """Take a sound chunk, unpacked."""
        self._entries = index_of(data)
        times = [log_ns for _, _, log_ns, *_ in messages]
        are_right = not times or (head.start_ns, head.end_ns) == (min(times), max(times))
        if not are_right or head.size != len(data):
            self._findings.flaw(record.at, record.at + HEAD.size + head.data_at, "damage in the head of a chunk")

    def index(self, record: Record) -> None:
        """Compare a message index that follows the chunk."""
        channel_id, entries = index_entries(record.content)
        if self._entries.get(channel_id) != entries:
            self._findings.flaw(record.at, record.end, "damage in a message index")
