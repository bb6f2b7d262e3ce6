"""Write a fit as JSON that a person can read, whole or not at all; `sysid.storage` reads it again.

The layout follows the dataclasses of `Fit` (see `sysid.layout`): a field added there or in a block needs no line here.
Criteria that follow from others stand in the file for who reads it. The version rises with `sysid.migrations`.
"""

import os
from pathlib import Path
from typing import Any

from sysid.files import write_text
from sysid.layout import encode, lines
from sysid.migrations import VERSION

FORMAT = "sysid fit"


def save(fit: Any, path: str | os.PathLike) -> Path:
    """Write a `sysid.Fit`; raises InputError for a model that text cannot hold or a place that cannot be written."""
    document = {"format": FORMAT, "version": VERSION, **encode(fit, "the fit")}
    document["criteria"] = encode(fit.criteria.as_dict(), "the fit, criteria")
    document["theta"] = dict(zip(fit.model.names, document["theta"], strict=True))
    return write_text(path, lines(document) + "\n")
