"""The verb: a port in use, a folder that is no session, NiceGUI that is missing, Ctrl-C."""

import socket
import sys

import pytest
from app_served import app

from twin.cli import main

pytest.importorskip("nicegui", reason="NiceGUI is in the app extra")


def test_ctrl_c_ends_it_with_a_sentence_and_the_session_opens_again(tmp_path):
    with app(tmp_path / "session") as served:
        code, said = served.stop()
    assert code == 130
    assert f"qpal: stopped; the session is kept; open it again with: qpal app --session {tmp_path / 'session'}" in said
    assert "Traceback" not in said
    assert (tmp_path / "session" / "session.json").is_file()


def test_a_port_in_use_is_a_sentence_and_leaves_no_session(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["app", "--port", str(port), "--no-browser"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"qpal: port {port} cannot be used: ")
    assert "--port" in said.partition(";")[2]
    assert list(tmp_path.iterdir()) == []


def test_a_port_that_is_none_is_refused(capsys):
    assert main(["app", "--port", "70000"]) == 2
    assert "65535" in capsys.readouterr().err


def test_without_nicegui_the_command_that_installs_it_is_named(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "nicegui", None)
    monkeypatch.setattr("twin.app.server.find_spec", lambda name: None)
    assert main(["app"]) == 2
    assert 'pip install "qpal[app]"' in capsys.readouterr().err


def test_a_folder_of_other_files_is_no_session(tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("x")
    assert main(["app", "--session", str(tmp_path), "--no-browser"]) == 2
    assert "holds other files" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
