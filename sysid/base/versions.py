"""With what a result was made."""

import platform
from importlib import metadata

PACKAGES = ("qpal", "mujoco", "numpy", "scipy", "numba", "control")


def versions() -> dict[str, str]:
    """Version of Python and of every package that a number can depend on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found
