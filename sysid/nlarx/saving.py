"""Save a nonlinear ARX model as readable JSON, as `sysid.estimation.saving` does for a chain."""

import os
from pathlib import Path
from typing import Any

from sysid.estimation.saving import write

FORMAT, VERSION = "sysid nlarx fit", 2  # version 1 stored no offsets and no origin: they stay unknown (None)


def save(fit: Any, path: str | os.PathLike) -> Path:
    """Write a `sysid.NlarxFit`; raises InputError for a path that cannot be written."""
    return write(fit, fit.network.names, {"format": FORMAT, "version": VERSION}, path)
