"""What `qpal` itself does: version, help, completion, and an end that comes whatever swallows the first request."""

import signal
import subprocess
import sys
import time
from importlib import metadata

import pytest
import typer

from twin.cli import main
from twin.cli.app import build

# A verb whose first interrupt is lost, and whose cleanup takes longer than the pause between two requests.
LOSES = """
import os, shutil, signal, sys, time
from twin.cli import app, main, options
from twin.cli.output import run_folder

class Loses:
    def __del__(self):
        print("ready", flush=True)
        time.sleep(30)  # an exception that rises here is printed and dropped

remove = shutil.rmtree
def slowly(path, **options):
    for _ in range(4):
        os.kill(os.getpid(), signal.SIGINT)  # somebody is impatient
        time.sleep(0.4)
    remove(path, **options)
    print("removed", flush=True)

def slow(out: options.Out = None) -> None:
    "Lose an interrupt."
    with run_folder(out, "slow"):
        shutil.rmtree = slowly
        first = Loses()
        del first
        print("went on", flush=True)
        time.sleep(300)

app.VERBS = (*app.VERBS, slow)
sys.exit(main(["slow"]))
"""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="Windows has no timer that interrupts")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_ends_within_seconds_although_the_first_request_is_lost(number, tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", LOSES], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    began = time.monotonic()
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert time.monotonic() - began < 15.0
    assert process.returncode == 130
    assert out == "went on\nremoved\n"  # the cleanup was let finish
    assert err.splitlines()[-1] == "qpal: stopped; nothing was written"
    assert not list(tmp_path.iterdir())


def test_handlers_are_what_they_were_after_a_run(capsys):
    numbers = [signal.SIGINT, signal.SIGTERM, *([signal.SIGALRM] if hasattr(signal, "SIGALRM") else [])]
    before = [signal.getsignal(number) for number in numbers]
    assert main(["--version"]) == 0
    assert [signal.getsignal(number) for number in numbers] == before
    if hasattr(signal, "getitimer"):
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_the_version_is_that_of_the_package(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"qpal {metadata.version('qpal')}\n"


GROUP = typer.main.get_command(build())
PATHS = [[], *([name] for name in GROUP.commands)]
PATHS += [[group, name] for group in ("rig", "bench") for name in GROUP.commands[group].commands]


@pytest.mark.parametrize("path", PATHS, ids=lambda path: "-".join(path) or "qpal")
def test_short_and_long_help_are_one(path, capsys):
    said = []
    for option in ("-h", "--help"):
        assert main([*path, option]) == 0
        said.append(capsys.readouterr().out)
    assert said[0] == said[1]
    assert "-h, --help" in said[0]


@pytest.mark.parametrize(
    ("shell", "word"), [("bash", "complete -o"), ("zsh", "#compdef qpal"), ("fish", "--command qpal")]
)
def test_completion_prints_a_script_of_the_shell_that_is_named(shell, word, capsys):
    assert main(["--show-completion", shell]) == 0
    out = capsys.readouterr().out
    assert word in out
    assert "_QPAL_COMPLETE" in out
    assert main(["--show-completion", "tcsh"]) == 2
    assert "tcsh" in capsys.readouterr().err


def test_completion_names_verbs_and_options(monkeypatch, capsys):
    monkeypatch.setenv("_QPAL_COMPLETE", "complete_bash")
    for words, found in (("qpal ide", {"identify"}), ("qpal run --hor", {"--horizon"})):
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
        assert main([]) == 0
        assert set(capsys.readouterr().out.split()) == found


@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT")
def test_a_request_to_stop_while_modules_load_is_a_sentence():
    code = """
import os, signal, sys
from twin.cli import main

class Late:
    def find_spec(self, name, *more):
        if name == "typer":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Late())
sys.exit(main(["info"]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (130, "qpal: stopped; nothing was written\n")
