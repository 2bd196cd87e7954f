"""`wayfix-onboard convert`: a recording of a serial port becomes a frames file."""

import argparse
import signal
import sys
from pathlib import Path
from typing import Any

from common.command import number, say_json


def add_arguments(commands: Any) -> None:
    """Add the sub-parser."""
    parser = commands.add_parser("convert", help="a recording into a frames file", description=_convert.__doc__)
    parser.add_argument("recording", metavar="IN", type=Path, help="raw recording of a serial port (NMEA and others)")
    parser.add_argument("out", metavar="OUT", type=Path, help="frames file to write (docs/frames-file.md)")
    parser.add_argument("--config", type=Path, metavar="BOAT.toml", help="whose sensors (default: those found in IN)")
    parser.add_argument("--port", metavar="NAME", help="[[port]] of --config that IN is a recording of")
    parser.add_argument(
        "--lines-per-second",
        type=number(float, 0.001, 100_000.0),
        metavar="X",
        help="pace of a recording without times inside (default: as fast as the baud rate)",
    )
    parser.add_argument("--json", action="store_true", help="the summary once more as the last line of stdout")
    parser.set_defaults(command=_convert)


def _convert(arguments: argparse.Namespace) -> int:
    """Run the daemon's decoders and framer over a recording, on the time inside its sentences or beside them.

    Exit code 1: no line of the recording was of any use.
    """
    from onboard.recorded.convert import convert, words

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        summary = convert(
            arguments.recording,
            arguments.out,
            config_file=arguments.config,
            port=arguments.port,
            lines_per_second=arguments.lines_per_second,
        )
    except KeyboardInterrupt:
        sys.stderr.write(f"stopped; {arguments.out} was not written\n")
        return 0
    sys.stdout.write("\n".join(words(summary)) + "\n")
    if not summary["accepted"]:
        sys.stderr.write(f"no line was accepted: {summary['instead']}\n")
    if arguments.json:
        say_json(**summary)
    return 0 if summary["accepted"] else 1
