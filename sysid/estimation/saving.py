"""Write a fit as readable JSON, whole or not at all; `sysid.estimation.storage` reads it again.

The layout follows the dataclasses of `Fit` (see `sysid.estimation.codec`): a field added there or in a block needs no
change here. The file includes derived criteria for its reader. The version rises with `sysid.estimation.migrations`.
"""

import os
from pathlib import Path
from typing import Any

from sysid.base.files import write_text
from sysid.estimation.codec import encode, lines
from sysid.estimation.migrations import VERSION

FORMAT = "sysid fit"


def save(fit: Any, path: str | os.PathLike) -> Path:
    """Write a `sysid.Fit`; raises InputError for a model that text cannot store or a path that cannot be written."""
    document = {"format": FORMAT, "version": VERSION, **encode(fit, "the fit")}
    document["criteria"] = encode(fit.criteria.as_dict(), "the fit, criteria")
    document["theta"] = dict(zip(fit.model.names, document["theta"], strict=True))
    return write_text(path, lines(document) + "\n")
