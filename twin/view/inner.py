"""MuJoCo's inner port: the viewer draws its page through a port of the loopback, which has no password.

A program of another user that took this connection could draw the page. Both of its ends are in this process, so a
connection of any other process is closed. Only Linux tells whose a connection is; elsewhere all are taken.
"""

import os
import socket
import sys
from contextlib import suppress
from typing import Any


def own_peers(listening: socket.socket) -> socket.socket:
    """The same listening socket, but it accepts connections of this process only."""
    return _OwnPeers(listening.family, listening.type, listening.proto, listening.detach())


class _OwnPeers(socket.socket):
    def accept(self) -> tuple[socket.socket, Any]:
        connection, address = super().accept()
        if sys.platform.startswith("linux") and not ours(connection):
            connection.close()
            raise ConnectionAbortedError  # the server waits for the next one
        return connection, address


def ours(connection: socket.socket) -> bool:
    """Whether the other end of an IPv4 connection within this machine is in this process (Linux)."""
    here, there = _written(connection.getsockname()), _written(connection.getpeername())
    with open("/proc/self/net/tcp", encoding="ascii") as file:
        rows = [line.split() for line in file]
    inodes = {row[9] for row in rows if row[1] == there and row[2] == here}
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # of a file that has been closed meanwhile
            if os.readlink(f"/proc/self/fd/{name}") in {f"socket:[{inode}]" for inode in inodes}:
                return True
    return False


def _written(address: tuple[str, int]) -> str:
    """An address as the kernel writes it: bytes in the order of the machine, in hexadecimal."""
    host = int.from_bytes(socket.inet_aton(address[0]), sys.byteorder)
    return f"{host:08X}:{address[1]:04X}"
