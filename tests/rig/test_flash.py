"""The firmware onto a board: the real compiler, and a script in place of avrdude in front of the simulated board."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sysid.base.errors import InputError
from twin.cli import main
from twin.rig import avr, flash
from twin.rig.avr import Avr, Port
from twin.rig.emulator import Emulator
from twin.rig.scripted import Legs

needs_compiler = pytest.mark.skipif(
    any(shutil.which(name) is None for name in flash.COMPILER), reason="install Debian's gcc-avr, avr-libc and make"
)
needs_board = pytest.mark.skipif(bool(avr.missing()), reason=avr.missing())


@pytest.fixture
def tools(tmp_path, monkeypatch):
    """A folder first on PATH, in which `tool(name, code)` puts scripts of Python."""
    place = tmp_path / "tools"
    place.mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{place}{os.pathsep}{os.environ['PATH']}")

    def tool(name, code):
        path = place / name
        path.write_text(f"#!{sys.executable}\nimport sys\n{code}\n")
        path.chmod(0o755)

    return tool


AVRDUDE = """
import json, shutil
given = sys.argv[1:]
json.dump(given, open("given.json", "w"))
shutil.copyfile(given[-1].split(":")[2], "written.hex")
"""


def image(text):
    """The bytes of an Intel hex file without gaps; each line's check sum holds."""
    found = b""
    for line in text.splitlines():
        row = bytes.fromhex(line[1:])
        assert line[0] == ":"
        assert len(row) == row[0] + 5
        assert sum(row) % 256 == 0
        if row[3] == 0:
            assert int.from_bytes(row[1:3], "big") == len(found)
            found += row[4:-1]
    assert row[3] == 1  # the end
    return found


def refused(capsys, *arguments):
    assert main(["rig", "flash", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


@needs_board
def test_a_board_is_written_and_says_who_it_is(tools, capsys):
    """What avrdude gets is the compiled program, and the arguments that its manual gives for this board."""
    tools("avrdude", AVRDUDE)
    board = Avr(Legs(np.random.default_rng(0)))
    for _ in range(5):  # it starts
        board.step()
    with Port(board) as port:
        assert main(["rig", "flash", port.port, "--yes", "--out", "kept.hex", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "hex": "kept.hex",
        "firmware": "qpal-mega2560 0.1.0",
        "port": port.port,
    }
    *arguments, last = json.loads(Path("given.json").read_text())
    assert arguments == ["-p", "atmega2560", "-c", "wiring", "-P", port.port, "-b", "115200", "-D", "-U"]
    assert last.startswith("flash:w:")
    assert last.endswith(":i")
    subprocess.run(["avr-objcopy", "-O", "binary", avr.build() / "firmware.elf", "program.bin"], check=True)
    assert image(Path("written.hex").read_text()) == Path("program.bin").read_bytes()
    assert Path("kept.hex").read_text() == Path("written.hex").read_text()


@needs_compiler
def test_another_firmware_that_answers_is_told(tools, capsys):
    tools("avrdude", AVRDUDE)
    with Emulator("shoulder", 1) as emulator:
        said = refused(capsys, emulator.port, "--yes")
        assert "qpal twin 1.0.0 answers, and qpal-mega2560 0.1.0 was written; press the board's reset key" in said
        assert main(["rig", "flash", emulator.port, "--yes", "--hex", "written.hex"]) == 0  # of which nobody knows more
    assert "qpal twin 1.0.0" in capsys.readouterr().out


def test_a_tool_that_fails_is_quoted(tools, capsys):
    tools("avrdude", 'print("Reading...\\nError: programmer is not responding", file=sys.stderr); sys.exit(1)')
    Path("x.hex").write_text(":00000001FF\n")
    with Emulator("shoulder", 1) as emulator:
        said = refused(capsys, emulator.port, "--yes", "--hex", "x.hex")
        assert "avrdude fails (Error: programmer is not responding); it needs a Mega 2560 on this port" in said
    tools("make", 'print("x.c:3: error: no", file=sys.stderr); sys.exit(2)')
    for name in flash.COMPILER[1:]:
        tools(name, "")
    assert "make fails (x.c:3: error: no); it needs gcc-avr and avr-libc" in refused(capsys, "--build-only")
    assert not Path("firmware.hex").exists()


def test_a_tool_that_is_missing_is_named(tools, tmp_path, monkeypatch, capsys):
    """Without gcc-avr arduino-cli builds; a script stands for it, as its manual describes the arguments."""
    monkeypatch.setenv("PATH", str(tmp_path / "tools"))
    assert "install Debian's gcc-avr, avr-libc and make, or arduino-cli" in refused(capsys, "--build-only")
    Path("x.hex").write_text(":00000001FF\n")
    with Emulator("shoulder", 1) as emulator:
        assert "install Debian's avrdude" in refused(capsys, emulator.port, "--yes", "--hex", "x.hex")
    code = """
assert sys.argv[1:4] == ["compile", "--fqbn", "arduino:avr:mega"]
assert open(sys.argv[6] + "/firmware.ino")
open(sys.argv[5] + "/firmware.ino.hex", "w").write(":00000001FF\\n")
"""
    tools("arduino-cli", code)
    assert main(["rig", "flash", "--build-only", "--out", "y.hex"]) == 0
    assert Path("y.hex").read_text() == ":00000001FF\n"


def test_bad_arguments_get_a_sentence(tools, capsys, monkeypatch):
    tools("avrdude", "sys.exit('it was called')")
    Path("d.csv").write_text("time [s],u [V]\n0,1\n")
    Path("x.hex").write_text(":00000001FF\n")
    for arguments, said in (
        (["nowhere", "--hex", "x.hex", "--yes"], "there is no such port"),
        (["nowhere", "--hex", "d.csv", "--yes"], "d.csv is no file of Intel hex; make one with qpal rig flash"),
        (["nowhere", "--hex", "none.hex", "--yes"], "none.hex is no file of Intel hex"),
        (["nowhere", "--hex", "x.hex"], "will be replaced. To confirm where nobody can be asked, give --yes"),
        (["nowhere", "--build-only"], "leave out the port, or --build-only"),
        (["--hex", "x.hex", "--out", "y.hex"], "leave out --build-only and --out"),
        (["--build-only", "--out", "no/y.hex"], "there is no folder no"),
    ):
        assert said in refused(capsys, *arguments)
    for ports, said in (([("S0", "n/a")], "connect the board's USB cable"), ([("A", "x"), ("B", "y")], "A, B; give")):
        monkeypatch.setattr(flash, "ports", lambda found=ports: found)
        with pytest.raises(InputError, match=said):
            flash.only_port()
    monkeypatch.setattr(flash, "ports", lambda: [("S0", "n/a"), ("ACM0", "Arduino Mega 2560")])
    assert flash.only_port() == "ACM0"
