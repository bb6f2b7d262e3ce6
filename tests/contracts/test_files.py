"""What every saved or reported file stands on: JSON values, files whole or not at all, lines that survive a kill."""

import json

import numpy as np
import pytest

from sysid.json_values import plain


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.array([[1.5, np.nan], [np.inf, -0.0]]), "[[1.5, null], [null, -0.0]]"),
        ({"a": np.int64(3), "b": (np.bool_(True), False)}, '{"a": 3, "b": [true, false]}'),
        (np.array([1 + 2j]), "[[1.0, 2.0]]"),
        (complex(np.inf, 0), "[null, 0.0]"),
        ([None, "text", np.float32(0.5), np.arange(2)], '[null, "text", 0.5, [0, 1]]'),
    ],
)
def test_plain_values_are_what_json_holds(value, expected):
    assert json.dumps(plain(value), allow_nan=False) == expected
