"""A devpts of its own for a process that runs tests: its pseudo-terminals are nobody else's.

The kernel gives the number of a closed pseudo-terminal to the next program that opens one. A daemon whose adapter was
pulled out would find another program's terminal behind `/dev/pts/N`, read from it, and take its lines away. In a mount
namespace with a devpts of its own only this process' own children count. Everything else stays as it is: mounts of the
machine are still seen, and none of ours is seen outside.
"""

import ctypes
import os

_NEW_MOUNTS = 0x20000  # CLONE_NEWNS; os.unshare came with Python 3.12
_SLAVE_ALL = 0x80000 | 0x4000  # MS_SLAVE | MS_REC: what the machine mounts comes in, nothing goes out
_OPTIONS = b"newinstance,ptmxmode=0666,mode=0620"


def take() -> str | None:
    """Give the calling thread, and what it starts, pseudo-terminals of its own; why it has none, in one sentence."""
    shared = "shared with all programs ({}): a test that gives one up may meet another's"
    if os.geteuid() != 0:
        return shared.format("own ones need root")
    libc = ctypes.CDLL(None, use_errno=True)
    if (
        libc.unshare(_NEW_MOUNTS) != 0
        or libc.mount(None, b"/", None, ctypes.c_ulong(_SLAVE_ALL), None) != 0
        or libc.mount(b"devpts", b"/dev/pts", b"devpts", ctypes.c_ulong(0), _OPTIONS) != 0
    ):
        return shared.format(os.strerror(ctypes.get_errno()))
    return None
