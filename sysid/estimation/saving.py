"""Write a fit as readable JSON, whole or not at all; `sysid.estimation.storage` reads it again.

The layout follows the dataclasses of `Fit` (see `sysid.estimation.codec`): a field added there or in a block needs no
change here. The file includes derived criteria for its reader. The version rises with `sysid.estimation.migrations`.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sysid.base.files import write_text
from sysid.estimation.codec import encode, lines
from sysid.estimation.migrations import VERSION

FORMAT = "sysid fit"


def save(fit: Any, path: str | os.PathLike) -> Path:
    """Write a `sysid.Fit`; raises InputError for a model that text cannot store or a path that cannot be written."""
    return write(fit, fit.model.names, {"format": FORMAT, "version": VERSION}, path)


def write(fit: Any, names: Sequence[str], head: Mapping[str, Any], path: str | os.PathLike) -> Path:
    """Write a fit behind a `head`, with the `names` of its parameters."""
    document = {**head, **encode(fit, "the fit")}
    document["criteria"] = encode(fit.criteria.as_dict(), "the fit, criteria")
    document["theta"] = dict(zip(names, document["theta"], strict=True))
    return write_text(path, lines(document) + "\n")
