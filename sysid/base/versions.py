"""Versions behind a result."""

import platform
from importlib import metadata

PACKAGES = ("qpal", "mujoco", "numpy", "scipy", "numba", "control")


def versions() -> dict[str, str]:
    """Version of Python and of every package that can affect a number."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found
