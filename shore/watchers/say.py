"""Event messages for the person at the terminal: a line each, with the cure where there is something to do."""

from collections.abc import Callable

from common.events import line_of
from common.messages import LEVELS, Event
from shore.settings.station import DEFAULTS, StationSettings
from shore.watchers.watcher import Step, Watcher


class SayEvents(Watcher):
    """Says what happened on board, in the filters and to the link; what lies below `events_from` is in the log."""

    def __init__(self, say: Callable[[str], None], settings: StationSettings = DEFAULTS) -> None:
        self._say = say
        self._levels = LEVELS[LEVELS.index(settings.display.events_from) :]

    def take(self, step: Step) -> None:
        """Print the events of the frame and of the pipeline."""
        for event in step.events:
            self._say_event(event)

    def happened(self, event: Event, t_ns: int) -> None:
        """Print an event of the source."""
        self._say_event(event)

    def _say_event(self, event: Event) -> None:
        if event.level in self._levels:
            self._say(f"{event.level}: {line_of(event)}")
