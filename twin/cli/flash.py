"""`qpal rig flash`: the firmware onto a board."""

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from sysid.base.errors import InputError
from twin.cli import options
from twin.cli.cable import Yes, ask, say
from twin.cli.output import check_writable_file
from twin.cli.results import note_result


def flash(
    port: Annotated[
        str | None, typer.Argument(metavar="PORT", help="serial port; that of the only device if not given")
    ] = None,
    hex: Annotated[
        str | None, typer.Option("--hex", metavar="FILE.hex", help="a built firmware, instead of the sources")
    ] = None,
    build_only: Annotated[bool, typer.Option("--build-only", help="write no board; keep the built file")] = False,
    out: Annotated[
        str | None, typer.Option("--out", metavar="FILE.hex", help="keep the built file; firmware.hex if none is named")
    ] = None,
    yes: Yes = False,
    as_json: options.Json = False,
) -> None:
    """Write the firmware onto an Arduino Mega 2560.

    It is built by gcc-avr, or arduino-cli, and written by avrdude; then the board is asked for its name and version.

    Limit: 2 min for each of the tools.
    """
    from twin.rig.flash import build, only_port, release, upload

    if hex is not None and (build_only or out is not None):
        raise InputError("--hex is a built firmware; leave out --build-only and --out")
    if build_only and port is not None:
        raise InputError("--build-only writes no board; leave out the port, or --build-only")
    kept = Path(out or "firmware.hex") if build_only or out is not None else None
    if kept is not None:
        check_writable_file(kept)
    target = None if build_only else port or only_port()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(hex) if hex is not None else build(Path(folder))
        summary: dict[str, object] = {}
        sentences = []
        if kept is not None:
            _copy(file, kept)
            summary, sentences = {"hex": str(kept), "firmware": " ".join(release())}, [f"Written: {kept}"]
        if target is not None:
            ask(f"The program of the board on {target} will be replaced.", yes)
            found = upload(file, target).release
            if hex is None and found != " ".join(release()):
                raise InputError(
                    f"{target}: {found} answers, and {' '.join(release())} was written; press the board's reset key, "
                    f"then ask it: qpal rig find --port {target}"
                )
            summary |= {"port": target, "firmware": found}
            sentences += [f"{target}: {found}", f"Next: qpal rig wire thigh --port {target}"]
    say(summary, as_json, *sentences)


def _copy(file: Path, kept: Path) -> None:
    from sysid.base.files import write_text

    write_text(kept, file.read_text(encoding="ascii"))
    note_result(kept)
