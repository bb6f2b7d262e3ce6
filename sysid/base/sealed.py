"""Rows of JSON that carry a check sum over their content and over what they belong to.

A row that was changed by hand, damaged on a disk or copied from another file does not hold. This finds accidents: who
wants to deceive can compute the check sum too.
"""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

CHECK = "check"
DAMAGED, UNSEALED = "damaged", "unsealed"


def sealed(content: Mapping[str, Any], belongs: str) -> dict[str, Any]:
    """`content` with its check sum; `belongs` names what the row is part of."""
    return {**content, CHECK: check_sum(content, belongs)}


def check_sum(content: Mapping[str, Any], belongs: str) -> str:
    """The check sum of JSON values, whatever the order of their names."""
    return hashlib.sha256(json.dumps([belongs, content], sort_keys=True).encode()).hexdigest()[:32]


def opened(line: str, belongs: str) -> tuple[dict[str, Any], str]:
    """The content of a line, and "" if it holds, UNSEALED without a check sum, DAMAGED if it is not what was written.

    A damaged line has no content.
    """
    try:
        row = json.loads(line)
    except (ValueError, RecursionError):
        return {}, DAMAGED
    if not isinstance(row, dict):
        return {}, DAMAGED
    given = row.pop(CHECK, None)
    if given is None:
        return row, UNSEALED
    return (row, "") if given == check_sum(row, belongs) else ({}, DAMAGED)
