"""Every imperfection shows itself in an experiment of its own: its size out of the data against the parameter."""

import math
from functools import cache

import numpy as np
import pytest
from cases import OTHER_SIZES, SIGNATURES
from often import by_day

from twin import IMPERFECTIONS, Parameters
from twin.imperfections import Signature
from twin.parameters import TABLE as ROWS
from twin.signatures import TABLE, signatures

SETS = {"nominal": Parameters(), "other": Parameters(OTHER_SIZES)}
PERFECT = Parameters().switched_off(IMPERFECTIONS)
IDEAL = Parameters(
    {row.name: 0.0 for row in ROWS if row.lower == 0}
    | {row.name: PERFECT[row.name] for row in ROWS if row.lower <= PERFECT[row.name] <= row.upper}
)
STUCK = Parameters({"shoulder.coulomb": 20.0, "thigh.coulomb": 500.0, "shank.coulomb": 500.0})


@cache
def signature(key: str, parameters: str) -> Signature:
    return TABLE[key](SETS[parameters])


def test_every_imperfection_has_a_signature() -> None:
    assert [key for key in TABLE if key in IMPERFECTIONS] == list(IMPERFECTIONS)
    assert set(SIGNATURES) == set(TABLE)


@pytest.mark.parametrize("parameters", by_day(SETS, "other"))
@pytest.mark.parametrize("key", TABLE)
def test_measured_size_is_the_parameters(key: str, parameters: str) -> None:
    for size in signature(key, parameters).sizes:
        assert size.true != 0
        assert size.measured == pytest.approx(size.true, rel=SIGNATURES[key][0]), size.name


@pytest.mark.parametrize("parameters", by_day(SETS, "other"))
@pytest.mark.parametrize("key", TABLE)
def test_without_the_imperfection_the_size_vanishes(key: str, parameters: str) -> None:
    for size in signature(key, parameters).sizes:
        # 0.5 %: the distance of two codes or PWM levels is then that of two samples on the way.
        assert math.isnan(size.off) or abs(size.off) < 0.005 * abs(size.true), size.name


@pytest.mark.parametrize("key", TABLE)
def test_a_signature_says_what_it_is(key: str) -> None:
    found = signature(key, "nominal")
    assert found.key == key
    assert found.name in IMPERFECTIONS  # a second signature of one goes by another key
    assert {line.on for line in found.lines} == {True, False}
    assert all(len(line.x) == len(line.y) and np.isfinite(line.x).all() for line in found.lines)
    assert found.marks
    assert found.sentence.endswith(".")
    names = {row.name for row in ROWS}
    assert all(row in names for size in found.sizes for row in size.rows)


def test_sizes_of_the_two_sets_differ_by_more_than_any_tolerance() -> None:
    for key in set(TABLE) - {"contact"}:  # its floor is put where the foot is to touch
        for a, b in zip(signature(key, "nominal").sizes, signature(key, "other").sizes, strict=True):
            assert abs(a.true / b.true - 1) > 2 * SIGNATURES[key][0], a.name


def gone(name: str) -> bool:
    """Whether nothing of an imperfection is left in the ideal parameters."""
    changed = {row: v for row, v in Parameters().switched_off((name,)).items() if v != Parameters()[row]}
    return bool(changed) and all(IDEAL[row] == value for row, value in changed.items())


@pytest.mark.parametrize("parameters", [IDEAL, STUCK], ids=["ideal", "stuck"])
def test_a_joint_without_imperfections_or_without_motion_is_no_error(parameters: Parameters) -> None:
    found = signatures(parameters)
    assert len(found) == len(TABLE)
    if parameters is IDEAL:
        assert sum(map(gone, IMPERFECTIONS)) > len(IMPERFECTIONS) / 2
        for each in found:
            if gone(each.name):
                assert math.isnan(each.sizes[0].measured) or abs(each.sizes[0].measured) < 1e-5, each.key
