"""The exception hierarchy: a fault that a person can cure says what, where and what to do.

Exception
└── WayfixError           a person outside the program has to do something: says what, where and how to cure it
    ├── SettingsError     a configuration file is wrong (all its faults at once)
    ├── CodecError        bytes that are not a message of ours
    └── LinkError         the other side refused, or broke the protocol
        └── NoAnswerError     no answer came: one may come later

Bad sensor data is never an exception: drivers return a `Reject` with a reason (`onboard.devices`).
"""


class WayfixError(Exception):
    """A fault outside the program, with what a person needs to act on it.

    Only `main` of either side prints it: one sentence, exit code 2.
    """

    def __init__(self, what: str, where: str = "", cure: str = "") -> None:
        super().__init__(what)
        self.what = what
        self.where = where
        self.cure = cure

    def __str__(self) -> str:
        text = f"{self.where}: {self.what}" if self.where else self.what
        return f"{text}; {self.cure}" if self.cure else text


class SettingsError(WayfixError):
    """A configuration file is wrong; `faults` has one line for each fault found."""

    def __init__(self, file: str, faults: list[str], cure: str = "") -> None:
        self.faults = faults
        lines = "\n".join(f"{file}: {fault}" for fault in faults)
        super().__init__(lines, cure=cure)


class CodecError(WayfixError):
    """Bytes that are not a message of ours; the text names the field at fault."""


class LinkError(WayfixError):
    """The other side of the link cannot be reached, refused, or broke the protocol."""


class NoAnswerError(LinkError):
    """No answer came in time; a later attempt may get one."""
