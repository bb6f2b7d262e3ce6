"""What the verbs of `qpal rig` share: their options, the line to a rig, its calibration, questions before it moves."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sysid.base.errors import InputError, unknown
from twin.cli import console, options
from twin.cli.output import check_writable_file
from twin.parameters import JOINTS

if TYPE_CHECKING:
    from twin.rig.calibration import Calibration
    from twin.rig.leg import Emulated
    from twin.rig.link import Link

EMULATED = ("twin", "firmware")
BUSES = ("feetech", "dynamixel")  # `twin.rig.bus.registers.FAMILIES`, whose import would slow the help text down
FILE = "rig.toml"  # `twin.rig.calibration.DEFAULT`, whose import would slow the help text down

Emulate = Annotated[
    str | None,
    typer.Option(
        "--emulate",
        metavar="NAME",
        help=f"a rig without hardware, instead of a port: {', '.join((*EMULATED, *BUSES))}",
    ),
]
Seed = Annotated[int, options.whole_number("N", "of the emulated leg, its wiring and its noise")]
Port = Annotated[
    str | None,
    typer.Option("--port", metavar="PORT", help="serial port, if not that of --rig; see qpal rig find"),
]
RigFile = Annotated[str, typer.Option("--rig", metavar="FILE.toml", help="how the joint is wired, and its limits")]
Servos = Annotated[str | None, options.name("servos on a bus, instead of a board", BUSES)]
Yes = Annotated[bool, typer.Option("--yes", help="go on without asking first")]
Speed = Annotated[
    float | None, options.number("X", "seconds of the emulated leg in a second; as many as go if not given")
]


@contextmanager
def rig_on(
    port: str | None, emulate: str | None, joint: str, seed: int, speed: float | None = None
) -> "Iterator[tuple[Link, Emulated | None]]":
    """The line to a rig, and the rig itself where it is emulated."""
    from twin.rig.link import Link

    if emulate is None:
        if port is None:
            raise InputError("no port is given; see qpal rig find, then give --port, or --emulate twin without a rig")
        with Link(port) as link:
            yield link, None
        return
    if emulate not in EMULATED:
        raise unknown("emulated rig", emulate, EMULATED)
    if speed is not None and not 0.0 < speed < 1e6:
        raise InputError(f"--speed is {speed:g}; give a positive number, or leave it out")
    if speed is not None and emulate == "firmware":
        raise InputError("the firmware runs in the time of a clock; leave --speed out, or give --emulate twin")
    with _emulated(emulate, joint, options.seed(seed), speed) as emulator, Link(emulator.port) as link:
        yield link, emulator


def _emulated(name: str, joint: str, seed: int, speed: float | None) -> "Emulated":
    """A rig without hardware, by its name."""
    if name == "twin":
        from twin.rig.emulator import Emulator

        return Emulator(joint, seed, speed=speed)
    from twin.rig.simulated import Simulated

    return Simulated(joint, seed)


def known_calibration(rig: str, emulate: str | None) -> "Calibration | None":
    """The calibration in the file; None for an emulated rig without the usual one, which is wired and zeroed first."""
    from twin.rig import calibration as calibrations

    if emulate is not None and rig == calibrations.DEFAULT and not Path(rig).exists():
        return None
    return calibrations.read(rig)


def check_known(known: "Calibration | None", link: "Link", emulator: "Emulated | None") -> None:
    """Raises InputError, before anything moves, where the rig is another than that of its calibration."""
    from twin.rig.wiring import board_on, check_rig

    if known is not None:
        options = f" --port {link.port} --rig other.toml"
        if emulator is not None:
            options = same_rig("other.toml", emulator.kind, emulator.seed)
        check_rig(
            link,
            known,
            board_on(link, None if emulator is None else emulator.seed),
            f"qpal rig wire {known.joint}{options}",
        )


def first_calibration(
    link: "Link",
    joint: str,
    channel: int | None,
    supply: float,
    largest: float | None,
    emulator: "Emulated | None",
    supply_full: float | None = None,
) -> "Calibration":
    """What is known of a joint before its wiring is found."""
    from twin.rig.calibration import SUPPLY_FULL, of_joint
    from twin.rig.wiring import board_on

    if joint not in JOINTS:
        raise unknown("joint", joint, JOINTS)
    return of_joint(
        link.port,
        joint,
        JOINTS.index(joint) if channel is None else channel,
        supply,
        supply if largest is None else largest,
        0.0 if emulator is None else emulator.linearity,
        board_on(link, None if emulator is None else emulator.seed),
        SUPPLY_FULL if supply_full is None else supply_full,
    )


def emulated_calibration(link: "Link", joint: str, emulator: "Emulated | None") -> "Calibration":
    """The calibration of an emulated rig, found as on a real one."""
    from twin.rig.wiring import find_ends, find_wiring
    from twin.rig.wiring import zero as zeroed

    assert emulator is not None
    wired = find_wiring(
        link, first_calibration(link, joint, None, emulator.supply, None, emulator), lambda sentence: None
    )
    return zeroed(wired, find_ends(link, wired, lambda sentence: None, lambda _, counts: emulator.angle_of(counts)))


def check_angles(low: float | None, high: float | None) -> None:
    """Raises InputError, before anything moves, for angles [deg] that no two ends have."""
    for name, angle in (("--low", low), ("--high", high)):
        if angle is not None and not abs(angle) <= 720.0:
            raise InputError(f"{name} is {angle:g}; give an angle from -720 to 720 degrees")
    if low is not None and low == high:
        raise InputError(f"--low and --high are both {low:g}; give the angle of each end")


def angle_of_end(given: float | None, end: str, counts: float, emulator: "Emulated | None") -> float:
    """The angle [rad] of an end: given in degrees, known to an emulated rig, or asked for."""
    if given is None and emulator is not None:
        return emulator.angle_of(counts)
    if given is None:
        given = typer.prompt(f"Angle at the end of {end} counts [deg]", type=float)
    return radians(given)


def ask(sentence: str, yes: bool) -> None:
    """Ask before something moves. Raises InputError for no, and where nobody can be asked."""
    if yes:
        return
    if not sys.stdin.isatty():
        raise InputError(f"{sentence} To confirm where nobody can be asked, give --yes")
    if not typer.confirm(f"{sentence} Go on?"):
        raise InputError("nothing was moved")


def check_new_file(path: str) -> None:
    """Raises InputError before the work where the calibration cannot be written."""
    if Path(path).suffix != ".toml":
        raise InputError(f"--rig is {path}; a calibration is a TOML file: end its name in .toml")
    check_writable_file(Path(path))


def check_replaced(path: str, joint: str, bus: str | None) -> None:
    """Raises InputError where the file at `path` is that of another rig, which `wire` would write over."""
    from twin.rig.calibration import read_toml

    try:
        there = read_toml(path)
    except InputError:
        return  # none, or a damaged one
    if (there.get("joint"), there.get("bus")) != (joint, bus):
        kind = f"a {there['bus']} servo" if "bus" in there else "a joint on a board"
        raise InputError(f"{path} is that of the {there.get('joint')}, {kind}; give another --rig, or move it away")


def same_rig(rig: str, emulate: str | None, seed: int) -> str:
    """The options with which the next verb finds the same rig."""
    return f" --rig {rig}" + ("" if emulate is None else f" --emulate {emulate} --seed {seed}")


def speaker(as_json: bool) -> Callable[[str], None]:
    return (lambda sentence: None) if as_json else print


def say(summary: dict[str, Any], as_json: bool, *sentences: str) -> None:
    if as_json:
        console.show_json(summary)
    else:
        print("\n".join(sentences))
