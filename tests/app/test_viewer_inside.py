"""What a viewer in the browser does with another model, and with its inner port."""

import os
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from app_served import viewer

import twin
from twin.hardware.linkage import end_angles
from twin.view.replay import Replay, movement

pytest.importorskip("websockets", reason="it is what the viewer's server is made of")

LISTENING, CONNECTED = "0A", "01"


@pytest.fixture
def replay():
    """A thigh that goes up and down for 4 s."""
    t = np.arange(41) * 0.1
    low, high = end_angles(twin.Parameters(), "thigh")
    y = low + (high - low) * (1 - np.cos(np.pi * t)) / 2
    return Replay(movement(twin.Log(12 * np.sin(t), y, 0.1, joint="thigh")))


def simulation(shown, monkeypatch):
    """The viewer's end and the simulation's end of `qpal view --web`, without a server."""
    from mujoco.studio import launch_thread, launch_web, plugin, viewer_handle

    from twin.view import web

    given = {}
    monkeypatch.setattr(launch_web, "run", lambda config, **options: given.update(options))
    web.serve(shown, 1.0, 0)
    viewer, sim = launch_thread.make_thread_endpoints()
    handle = viewer_handle.ViewerHandle(
        sim,
        is_alive_fn=lambda: True,
        shutdown_fn=lambda *_: None,
        forward_error_fn=lambda: None,
        sim_plugins=plugin.split_plugins(given["plugins"])[1],
    )
    handle.set_model(given["model"], data=given["data"])
    return viewer, handle


@pytest.mark.parametrize("path", ["dropped.xml", ""], ids=["dropped", "reload"])
@pytest.mark.parametrize("replayed", [True, False], ids=["replay", "robot"])
def test_another_model_neither_comes_in_nor_ends_the_viewer(replay, monkeypatch, tmp_path, path, replayed):
    from mujoco.studio import messages

    (tmp_path / "dropped.xml").write_text(
        '<mujoco><worldbody><body><joint type="ball"/><geom size="1"/></body></worldbody></mujoco>'
    )
    viewer, handle = simulation(replay if replayed else None, monkeypatch)
    shown = handle.model
    viewer.send_to_sim(messages.LoadModelEvent(path=str(tmp_path / path) if path else ""))
    for _ in range(3):
        handle.sync()  # raises what a frame raises, which ends the viewer
    assert handle.model is shown
    assert np.isfinite(handle.data.qpos).all()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux says whose a connection is")
def test_the_inner_port_takes_connections_of_its_own_process_alone():
    from twin.view.door import accept_own_process

    with accept_own_process(socket.create_server(("127.0.0.1", 0))) as listening:
        port = listening.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)) as mine:
            accepted, _ = listening.accept()
            accepted.sendall(b"in")
            assert mine.recv(2) == b"in"
            accepted.close()
        code = f"import socket; print(socket.create_connection(('127.0.0.1', {port}), 20).recv(2))"
        stranger = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        with pytest.raises(ConnectionAbortedError):
            listening.accept()
        assert stranger.communicate(timeout=60)[0] == "b''\n"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux says whose a connection is")
def test_a_stranger_at_the_inner_port_of_a_viewer_is_turned_away(tmp_path):
    with viewer(tmp_path) as (process, port, _):
        (inner,) = _ports(process.pid, LISTENING) - {port}
        before = _ends(process.pid, inner)
        with socket.create_connection(("127.0.0.1", inner), timeout=30) as line:
            assert line.recv(1) == b""
        assert _ends(process.pid, inner) == before  # a stranger that is taken pushes the viewer's own connection out
        assert process.poll() is None


def _ends(pid: int, inner: int) -> set[int]:
    """Both ends of the viewer's own connection to its inner port, once it is there."""
    end = time.monotonic() + 30
    while time.monotonic() < end:
        found = _ports(pid, CONNECTED)
        if inner in found and len(found) == 2:
            return found
        time.sleep(0.1)
    raise AssertionError("the viewer does not connect to itself")


def _ports(pid: int, state: str) -> set[int]:
    """Local ports of the sockets of a process in a state, as the kernel writes it."""
    mine = set()
    for name in os.listdir(f"/proc/{pid}/fd"):
        try:
            mine.add(os.readlink(f"/proc/{pid}/fd/{name}"))
        except OSError:
            continue
    with open("/proc/net/tcp") as file:
        rows = [line.split() for line in file][1:]
    return {int(row[1].split(":")[1], 16) for row in rows if row[3] == state and f"socket:[{row[9]}]" in mine}
