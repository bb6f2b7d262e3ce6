"""What is no file of data: pipes, devices, sockets, names that none can have. A sentence at once, from every reader."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import polars
import pytest

import sysid
import twin
from sysid.base.errors import InputError
from sysid.base.files import Lines, check_regular_file
from sysid.bench import table
from sysid.channels import mapping_file
from sysid.formats import TABLE, read_header, read_table
from twin import parameter_file
from twin.fragment import into

pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="pipes with names, and names of any bytes, are those of Unix"),
    pytest.mark.timeout(60),  # a reader that waits for a writer
]
READERS = {
    **{suffix: (f"a{suffix}", read_table) for suffix in TABLE},
    "header": ("a.csv", read_header),
    "model": ("a.json", sysid.load),
    "parameters": ("a.toml", parameter_file.read),
    "parameters in JSON": ("a.json", parameter_file.read),
    "mapping": ("a.toml", mapping_file._text),
    "MJCF": ("a.xml", into._parse),
    "journal": ("a.jsonl", lambda path: Lines(path).read()),
    "journal that grows": ("a.jsonl", lambda path: Lines(path).append("1")),
    "benchmark": ("a.parquet", table.parquet),
}


def pipe(path: Path) -> str:
    os.mkfifo(path)
    return "a named pipe"


def endless(path: Path) -> str:
    path.symlink_to("/dev/zero")
    return "a device"


def bound(path: Path) -> str:
    with socket.socket(socket.AF_UNIX) as made:
        here = os.getcwd()
        os.chdir(path.parent)  # a socket's name is short
        try:
            made.bind(path.name)
        finally:
            os.chdir(here)
    return "a socket"


def circle(path: Path) -> str:
    path.symlink_to(path.name)
    return "a link to itself"


@pytest.mark.parametrize("make", [pipe, endless, bound, circle])
@pytest.mark.parametrize("reader", READERS)
def test_what_is_no_file_is_refused_before_it_is_opened(reader, make, tmp_path):
    name, read = READERS[reader]
    words = make(tmp_path / name)
    with pytest.raises(InputError, match=words) as error:
        read(tmp_path / name)
    assert name in str(error.value)
    assert "\n" not in str(error.value)


NAMES = {
    "zero byte": ("a\0b", "zero byte|character of code 0"),
    "too long": ("x" * 300, "too long"),
    "far too long": ("y" * 200_000, "too long"),
    "no text": (os.fsdecode(b"m\xe9t"), "not UTF-8"),
}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("reader", READERS)
def test_a_name_that_no_report_could_show_is_a_sentence(reader, name, tmp_path):
    """The sentence is short, and any terminal takes it."""
    stem, words = NAMES[name]
    suffix = Path(READERS[reader][0]).suffix
    if name == "no text":
        (tmp_path / (stem + suffix)).write_text("u,y\n1,2\n2,3\n")
    with pytest.raises(InputError, match=words) as error:
        READERS[reader][1](tmp_path / (stem + suffix))
    said = str(error.value)
    assert len(said) < 400
    said.encode()
    assert said.isprintable()


def test_other_languages_spaces_and_links_are_names_like_any_other(tmp_path):
    for stem in ("Привод 1", "試験", "e\u0301", "😀", "a\tb", "~a", "-a"):
        path = tmp_path / f"{stem}.csv"
        path.write_text("u,y\n1,2\n2,3\n")
        (tmp_path / "link.csv").unlink(missing_ok=True)
        (tmp_path / "link.csv").symlink_to(path)
        assert read_table(path).numbers("u").tolist() == [1.0, 2.0]
        assert read_table(tmp_path / "link.csv").numbers("u").tolist() == [1.0, 2.0]
    assert check_regular_file(tmp_path / "missing") == tmp_path / "missing"
    assert check_regular_file(tmp_path) == tmp_path


def test_every_sentence_can_be_written(tmp_path):
    """The name of a file that is no text reaches messages from the system too."""
    said = str(InputError(f"{os.fsdecode(b'a' + bytes([0xE9]))} is damaged"))
    assert said == "a\\udce9 is damaged"
    assert str(InputError("größer als µ")) == "größer als µ"


def test_the_command_says_so_at_once(tmp_path):
    """Its standard error is ASCII here, and the name is not."""
    (tmp_path / os.fsdecode(b"m\xe9t.csv")).write_text("u,y\n1,2\n")
    os.mkfifo(tmp_path / "pipe.csv")
    for name, words in ((os.fsdecode(b"m\xe9t.csv"), "not UTF-8"), ("pipe.csv", "named pipe")):
        done = subprocess.run(
            [sys.executable, "-m", "twin.cli", "info", name],
            cwd=tmp_path,
            capture_output=True,
            timeout=60,
            env={**os.environ, "PYTHONIOENCODING": "ascii"},
        )
        said = " ".join(done.stderr.decode().split())
        assert done.returncode == 2
        assert words in said
        assert "Traceback" not in said


def test_a_cell_of_200_000_characters_is_a_short_sentence(tmp_path):
    for suffix, text in ((".csv", "u,y\n1,{}\n2,3\n"), (".json", '[{{"u": 1, "y": "{}"}}]'), (".log", "u,y\n1,{}\n")):
        (tmp_path / f"a{suffix}").write_text(text.format("x" * 200_000))
        with pytest.raises(InputError) as error:
            read_table(tmp_path / f"a{suffix}").numbers("y")
        assert len(str(error.value)) < 1000


@pytest.mark.parametrize("damage", ["half", "garbage", "panic"])
def test_a_damaged_table_of_our_own_is_a_sentence(damage, tmp_path, capfd, monkeypatch):
    """polars' core panics on some damages, which is no Exception, and prints."""
    ensemble = twin.Ensemble(twin.Experiment("thigh", "aprbs", 1.0), [3], None, tmp_path / "e").run()
    (part,) = (tmp_path / "e").glob("*.parquet")
    content = {"half": part.read_bytes()[: part.stat().st_size // 2], "garbage": bytes(range(256))}.get(damage)
    (tmp_path / "a.parquet").write_bytes(content or part.read_bytes())
    part.write_bytes(content or part.read_bytes())
    if damage == "panic":
        monkeypatch.setattr(polars, "read_parquet", panics)
    with pytest.raises(InputError, match="no results table"):
        table.read(tmp_path / "a.parquet")
    with pytest.raises(InputError, match="delete this file"):
        ensemble.table()
    assert capfd.readouterr().err == ""


def panics(*_, **__):
    os.write(2, b"thread 'polars-0' panicked at page.rs")
    raise polars.exceptions.PanicException("index out of bounds")


def test_a_name_of_a_million_letters_leaves_a_sentence_with_its_remedy(tmp_path):
    (tmp_path / "a.csv").write_text(
        "t,u," + "y" * 100_000 + "\n" + "".join(f"{k},{k % 7},{k % 5}\n" for k in range(30))
    )
    with pytest.raises(
        InputError, match=r"unknown column 'y+\.\.\.'; the closest is 'y+\.\.\.'; choose one of t, u"
    ) as said:
        sysid.read(tmp_path / "a.csv", "u", "y" * 99_999)
    assert len(str(said.value)) < 3000


def test_a_name_cannot_move_the_cursor_of_a_terminal(tmp_path):
    names = {"t": list(range(30)), "u\x1b[2J": list(range(30)), "y": list(range(30))}
    polars.DataFrame(names).write_parquet(tmp_path / "a.parquet")
    with pytest.raises(InputError) as said:
        sysid.read(tmp_path / "a.parquet", "x", "y")
    assert "\x1b" not in str(said.value)
    assert r"\x1b[2J" in str(said.value)


def test_a_log_does_not_replace_a_pipe(tmp_path):
    from twin.cli.output import check_writable_file

    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(InputError, match=r"pipe.csv .it is a pipe, a socket or a device, which a file would replace"):
        check_writable_file(tmp_path / "pipe.csv")
    (tmp_path / "log.csv").write_text("of before")
    check_writable_file(tmp_path / "log.csv")
    check_writable_file(tmp_path / "new.csv")
