"""Progress bars of an import on a terminal; without a terminal nothing is shown."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager


def frames_shown(items: Iterator[bytes], words: str, total: int | None) -> Iterable[bytes]:
    """The items; a bar counts them."""
    if not (sys.stderr and sys.stderr.isatty()):
        return items
    from rich.console import Console
    from rich.progress import track

    return track(items, description=words, console=Console(stderr=True), total=total, transient=True)


@contextmanager
def bytes_shown(words: str, size: int) -> Iterator[Callable[[int], None] | None]:
    """A bar over the bytes of a file; `None` where stderr is no terminal."""
    if not (sys.stderr and sys.stderr.isatty()):
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(words, total=size)
        yield lambda count: progress.advance(task, count)
