"""Logs as rigs and programs write them, each beside its right answer."""

from corpus import beginners, binaries, captures, cells, clocks, found, heads, marks, own_clocks, parted, programs
from corpus._log import Log, Refused, Right

PARTS = (marks, heads, clocks, cells, programs, captures, binaries, found, beginners, own_clocks, parted)
LOGS: dict[str, Log] = {name: entry for part in PARTS for name, entry in part.LOGS.items()}

__all__ = ["LOGS", "PARTS", "Log", "Refused", "Right"]
