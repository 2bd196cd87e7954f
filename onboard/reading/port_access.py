"""File permissions and open descriptors of a serial port: who may open it, who holds it, what to do about either."""

import errno
import grp
import os
import pwd
import stat
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_PROC: Final = Path("/proc")
_DEV: Final = Path("/dev")
_PSEUDO_TERMINALS: Final = range(136, 144)
"""Major numbers of the slave ends of pseudo-terminals."""
_FAR_END: Final = (os.makedev(5, 2), 0)
_ADAPTERS: Final = ("serial/by-id/*", "ttyUSB*", "ttyACM*", "ttyAMA*", "ttyTHS*", "ttySC*", "ttymxc*")
_NAMED: Final = 4


@dataclass(frozen=True, slots=True)
class Holder:
    """A process that has a port open."""

    pid: int
    name: str

    def __str__(self) -> str:
        return f"{self.name} (pid {self.pid})"


def owner_of(path: str) -> str | None:
    """Mode, owner and group of a port as `ls -l` shows them; `None` = it is not there."""
    try:
        status = Path(path).stat()
    except OSError:
        return None
    return f"{stat.filemode(status.st_mode)} {_user(status.st_uid)}:{_group(status.st_gid)}"


def holders_of(path: str, proc: Path = _PROC) -> list[Holder]:
    """Other processes that have the port open, as far as this user may see them. The far end of a pty is none."""
    try:
        wanted = Path(path).stat()
    except OSError:
        return []
    if not wanted.st_rdev:
        return []
    device, found = _identity(wanted), []
    for folder in proc.iterdir():
        if not folder.name.isdecimal() or int(folder.name) == os.getpid():
            continue
        devices = set(_devices(folder))
        is_far_end = _is_pty(wanted) and _FAR_END in devices
        if device in devices and not is_far_end:
            found.append(Holder(int(folder.name), _name(folder)))
    return sorted(found, key=lambda holder: holder.pid)


def why_denied(path: str, number: int) -> str:
    """What to do about a port that may not be opened; number: EACCES or EPERM."""
    try:
        status = Path(path).stat()
    except OSError:
        return "permission denied on the way to it"
    if number == errno.EPERM:
        return f"not permitted by the service: `systemctl edit wayfix-onboard`, DeviceAllow={_kind(status.st_rdev)} rw"
    user, group = _user(os.geteuid()), _group(status.st_gid)
    owner = f"permission denied: it is {owner_of(path)}"
    if status.st_mode & 0o060 != 0o060 or group == "root":
        return f"{owner}; a udev rule must let the group dialout read and write it"
    if status.st_gid in (os.getegid(), *os.getgroups()):
        return f"{owner}, and {user} is in that group: something else forbids it (AppArmor, a container)"
    if _is_member(user, status.st_gid):
        return f"{owner}; {user} is in the group {group} since the last login: log out and in again"
    return f"{owner}; `sudo usermod -aG {group} {user}`, then log out and in again"


def why_busy(path: str, proc: Path = _PROC) -> str:
    """Who holds a busy port."""
    found = holders_of(path, proc)
    if not found:
        return f"busy; another program holds it (`sudo fuser -v {path}` names it)"
    return f"busy; {_listed(found)} holds it"


def why_absent(path: str, dev: Path = _DEV) -> str:
    """What to do about a path that is not there."""
    if "://" in path or path.startswith(("can", "vcan", "i2c", str(dev / "i2c"))):
        return "no such device: only serial ports are read (socat makes a pseudo-terminal of a network address)"
    there = [str(found) for pattern in _ADAPTERS for found in sorted(dev.glob(pattern))]
    if not there or not path.startswith(f"{dev}/"):
        return "no such device"
    more = ", ..." if len(there) > _NAMED else ""
    return f"no such device; there are {', '.join(there[:_NAMED])}{more}"


def _listed(found: Iterable[Holder]) -> str:
    return " and ".join(map(str, found))


def _is_pty(status: os.stat_result) -> bool:
    return os.major(status.st_rdev) in _PSEUDO_TERMINALS


def _identity(status: os.stat_result) -> tuple[int, int]:
    """Number of a device; pseudo-terminals are numbered in each of their file systems."""
    return status.st_rdev, status.st_dev if _is_pty(status) else 0


def _devices(folder: Path) -> Iterator[tuple[int, int]]:
    """The devices that a process has open."""
    try:
        for descriptor in (folder / "fd").iterdir():
            try:
                yield _identity(descriptor.stat())
            except OSError:
                continue
    except OSError:
        return


def _name(folder: Path) -> str:
    """Name of a program: that of its script where an interpreter runs one."""
    try:
        words = (folder / "cmdline").read_bytes().split(b"\0")
    except OSError:
        return "?"
    names = [Path(os.fsdecode(word)).name for word in words if word and not word.startswith(b"-")]
    is_interpreted = len(names) > 1 and names[0].startswith(("python", "perl", "sh", "bash", "node"))
    return names[is_interpreted] if names else "?"


def _kind(device: int, proc: Path = _PROC) -> str:
    """Name of the device's driver as DeviceAllow= wants it."""
    major = str(os.major(device))
    try:
        rows = (proc / "devices").read_text(encoding="ascii").split("Block devices:")[0].splitlines()
    except OSError:
        rows = []
    return next((f"char-{row.split()[1]}" for row in rows if row.split()[:1] == [major]), "char-*")


def _user(uid: int) -> str:
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)


def _group(gid: int) -> str:
    try:
        return grp.getgrgid(gid).gr_name
    except KeyError:
        return str(gid)


def _is_member(user: str, gid: int) -> bool:
    try:
        return user in grp.getgrgid(gid).gr_mem
    except KeyError:
        return False
