"""The firmware onto a board: built from its sources, written by avrdude, and asked for its name and version."""

import re
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from sysid.base.errors import InputError
from twin.rig import wire
from twin.rig.avr import FIRMWARE
from twin.rig.link import Link, check_port, ports

# An Arduino Mega 2560: its boot loader speaks the protocol "wiring" and erases pages as it writes them (-D), see the
# page of avrdude.
BOARD = ("-p", "atmega2560", "-c", "wiring")
SPEED = ("-b", "115200", "-D")
FQBN = "arduino:avr:mega"
COMPILER = ("make", "avr-gcc", "avr-objcopy", "avr-size")
LONGEST = 120.0  # [s] of a tool


def build(folder: Path) -> Path:
    """The file .hex of the firmware, made within `folder` by gcc-avr, or by arduino-cli where only that is there.

    Raises InputError where neither is, and for a compiler that fails.
    """
    lacking = [name for name in COMPILER if shutil.which(name) is None]
    if not lacking:
        _run(("make", "-C", str(FIRMWARE), f"BUILD={folder}"), "gcc-avr and avr-libc")
        return folder / "firmware.hex"
    if shutil.which("arduino-cli"):
        command = ("arduino-cli", "compile", "--fqbn", FQBN, "--output-dir", str(folder), str(FIRMWARE))
        _run(command, "its core: arduino-cli core install arduino:avr")
        return folder / "firmware.ino.hex"
    raise InputError(
        f"the firmware cannot be built without {lacking[0]}; install Debian's gcc-avr, avr-libc and make, or "
        "arduino-cli, or give a built one by --hex"
    )


def release() -> tuple[str, str]:
    """Name and version of the firmware that these sources make."""
    text = (FIRMWARE / "player.c").read_text(encoding="utf-8")
    name = re.search(r'NAME\[16\] = "([^"]+)"', text)
    numbers = re.search(r"RELEASE\[3\] = \{(\d+), (\d+), (\d+)\}", text)
    assert name is not None
    assert numbers is not None
    return name[1], ".".join(numbers.groups())


def only_port() -> str:
    """The one port that has a device on it. Raises InputError if there is none, or more than one."""
    found = [name for name, text in ports() if text not in ("", "n/a")]
    if not found:
        raise InputError("no serial port has a device on it; connect the board's USB cable, or give its port")
    if len(found) > 1:
        raise InputError(f"more than one port has a device on it: {', '.join(found)}; give that of the board")
    return found[0]


def upload(file: Path, port: str) -> wire.Identity:
    """Write a .hex onto the board at `port`, and what the board then says of itself.

    Raises InputError where avrdude is missing or fails, the port is not there or in use, or the board does not answer.
    """
    if shutil.which("avrdude") is None:
        raise InputError("a board is written by avrdude, which is not installed; install Debian's avrdude")
    if not file.is_file() or not file.read_bytes().startswith(b":"):
        raise InputError(f"{file} is no file of Intel hex; make one with qpal rig flash --build-only")
    check_port(port)
    with tempfile.TemporaryDirectory() as folder:  # avrdude splits -U at colons: no name of a person's is in it
        copy = shutil.copyfile(file, Path(folder) / "firmware.hex")
        _run(("avrdude", *BOARD, "-P", port, *SPEED, "-U", f"flash:w:{copy}:i"), "a Mega 2560 on this port")
    with Link(port) as link:
        return link.identity


def _run(command: Sequence[str], need: str) -> None:
    """Run a tool. Raises InputError with what it says, and what it needs."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=LONGEST)
    except subprocess.TimeoutExpired:
        raise InputError(f"{command[0]} did not end within {LONGEST:.0f} s; it needs {need}") from None
    if done.returncode:
        lines = [line.strip() for line in (done.stderr + done.stdout).splitlines() if line.strip()]
        telling = [line for line in lines if "error" in line.lower()] or lines[-1:] or [f"exit {done.returncode}"]
        raise InputError(f"{command[0]} fails ({telling[0]}); it needs {need}")
