"""Command-line arguments that stand for settings (override), apart from their meaning: `--help` waits for no numpy."""

import argparse
from pathlib import Path

from common.command import number


def add_settings(parser: argparse.ArgumentParser, words: str = "", *, boat_is_config: bool = False) -> None:
    """Add `--settings` and its other spelling `--config`.

    words: what the command reads of it; boat_is_config: `--config` is the boat's file of this command.
    """
    parser.add_argument(
        "--settings",
        *(() if boat_is_config else ("--config",)),
        type=Path,
        metavar="FILE",
        help=f"the station's settings{words} (default ~/.config/wayfix/wayfix.toml where there is one)",
    )


def add_filter_arguments(parser: argparse.ArgumentParser, default: str, words: str = "") -> None:
    """Add `--filters` and `--step`. default: what holds without them. words: what --filters takes besides."""
    parser.add_argument("--filters", help=f"comma-separated, the first leads{words} (default {default})")
    parser.add_argument(
        "--step",
        type=_step,
        metavar="SECONDS",
        help="synchronous steps (the thesis' Fig. 3.14), 0.05 to 60; 0 = each measurement at its own time",
    )


def _step(text: str) -> float:
    return 0.0 if text.strip() == "0" else number(float, 0.05, 60.0)(text)
