"""A drawn record in a drawn layout is read by guess: the numbers are the truth, or a sentence says what is unclear."""

import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from layouts import Layout, Written, layouts, write
from often import FULL

from sysid import InputError, read_signals
from sysid.channels.signals import Signals


def test_a_record_is_read_right_or_refused_with_a_sentence():
    """Wrong: none. Refused: not most, for a reader that refuses everything is right too (measured: 44 %)."""
    seen: Counter[str] = Counter()

    @settings(max_examples=1500 if FULL else 80)
    @given(layout=layouts())
    def read(layout):
        with tempfile.TemporaryDirectory() as folder:
            made = write(layout, Path(folder))
            try:
                signals = read_signals(made.path)
            except InputError as error:
                seen["refused"] += 1
                assert "\n" not in str(error)  # noqa: PT017 - most draws raise none
                return
        check(layout, made, signals)
        seen["right"] += 1

    read()
    assert seen["right"] > (0.4 if FULL else 0.25) * sum(seen.values()), seen


def check(layout: Layout, made: Written, signals: Signals) -> None:
    """Every number of the record against the truth, in the unit that the record claims."""
    roles = [(s.column, s.unit) for s in (*signals.input, *signals.output)]
    if layout.header:
        assert roles[0][0] == layout.input, f"input is {roles[0][0]}"
        assert roles[1][0] == layout.output, f"output is {roles[1][0]}"
    assert signals.Ts == pytest.approx(layout.Ts, rel=2e-3 if layout.jitter < 0.1 else 1e-2)
    u, y = signals.input[0], signals.output[0]
    u_scale, y_scale = scale(u.unit, "V", made.u_factor), scale(y.unit, "rad", made.y_factor)
    t = signals.t + made.t[0]
    # Between samples the input is that of the last row, which may be nearly two steps old where steps differ.
    slack = 0.51 * 10.0**-layout.decimals
    known = ~signals.missing
    # A stamp may be off by its last digit or by the tolerated jitter; y then differs by as much as it moves meanwhile.
    off = signals.sampling.off + 2.0 * layout.jitter * layout.Ts + 1e-9
    speed = float(np.sum(np.abs(made.truth.waves[:, 0] * made.truth.waves[:, 1])))
    bow = made.truth.curvature * (2.5 * layout.Ts) ** 2 / 8.0 if signals.sampling.interpolated else 0.0
    error = np.abs(y.values / y_scale - made.truth.y(t))
    assert np.all(error[known] <= slack * max(1.0, 1.0 / (made.y_factor or 1.0)) * 10 + speed * off + bow)
    near = [made.truth.u(t + late) for late in (0.0, off, -off, -2.0 * layout.Ts * signals.sampling.interpolated)]
    values = u.values / u_scale
    if signals.sampling.interpolated:  # the mean of each step, between the values that the input has around it
        near += [made.truth.u(t + late * layout.Ts) for late in (-1.0, 0.5, 1.0, 1.5)]
        between = (np.min(near, axis=0) - 10 * slack <= values) & (values <= np.max(near, axis=0) + 10 * slack)
        assert np.all(between[known])
        return
    assert np.all(np.min([np.abs(values - u0) for u0 in near], axis=0)[known] <= 10 * slack)


def scale(unit: str, si: str, factor: float | None) -> float:
    """What the record's numbers are of the truth: 1 in SI; a record that claims no unit has the file's own numbers."""
    if unit == si:
        assert factor is not None, f"claims {unit}, which the file does not say"
        return 1.0
    assert unit == "", f"claims {unit}"
    return 1.0 / (factor or 1.0)
