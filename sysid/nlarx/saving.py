"""Save a nonlinear ARX model as readable JSON, as `sysid.estimation.saving` does for a chain."""

import os
from pathlib import Path
from typing import Any

from sysid.estimation.saving import write

FORMAT, VERSION = "sysid nlarx fit", 1


def save(fit: Any, path: str | os.PathLike) -> Path:
    """Write a `sysid.NlarxFit`; raises InputError for a path that cannot be written."""
    return write(fit, fit.network.names, {"format": FORMAT, "version": VERSION}, path)
