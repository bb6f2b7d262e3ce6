"""An imperfection that only declares its step, its effect and its experiment acts in the compiled board."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from twin import Parameters
from twin.ensemble.draws import whole_box
from twin.experiment import SETTLE

TOYS = Path(__file__).parents[1] / "toy_imperfections.py"
STEP, T = 0.001, 0.01 * np.arange(400)


@pytest.fixture(scope="module")
def found():
    done = subprocess.run([sys.executable, str(TOYS)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


def test_a_state_moves_once_a_step_and_changes_the_motor_voltage(found):
    run, base = (np.array(volts) for volts in found["warm"])
    assert np.ptp(base[2:]) == 0.0
    warmth = base[2:] / run[2:] - 1.0
    # dw/dt = heating V^2 - w / cooling by Euler's steps, from the first command on.
    rise, keep = STEP * 1e-3 * base[-1] ** 2, 1.0 - STEP / 2.0
    steps = np.round(T[2:] / STEP)
    exact = rise * (1.0 - keep**steps) / (1.0 - keep)
    assert warmth == pytest.approx(exact, abs=12 * rise)  # the board looks at commands once in 10 steps
    assert warmth[-1] > 100 * rise


def test_a_sensor_that_drifts_reads_more_by_its_rate_and_time(found):
    run, base = (np.array(error) for error in found["drift"])
    assert np.ptp(base) < 1e-12
    assert run - base == pytest.approx(0.01 * (SETTLE + T), abs=2 * 0.01 * STEP)


def test_effects_of_a_group_act_one_after_the_other(found):
    run, base = (np.array(reading) for reading in found["glare"])
    assert run == pytest.approx(2.0 * base, abs=1e-12)
    assert np.ptp(base) > 0.01


def test_the_bound_of_dry_friction_is_what_the_effect_makes_of_it(found):
    for run, base in found["rust"]:  # down and up
        assert base > 0.1
        assert run < 1e-3


def test_the_declared_experiment_is_a_signature(found):
    on, off = found["shown"]
    assert off == pytest.approx(0.0, abs=1e-9)
    assert on > 1e-4


def test_compiled_code_of_another_effect_is_not_taken_from_the_cache(found):
    mark, again, other = found["marks"]
    assert mark == again != other


def test_rows_of_a_new_imperfection_leave_an_ensembles_numbers_as_they_were(found):
    draws = [whole_box().draw(Parameters(), number) for number in range(8)]
    assert any(draw.redrawn for draw in draws)
    for draw, values in zip(draws, found["drawn"], strict=True):
        assert {name: values[name] for name in draw.parameters.values} == dict(draw.parameters.values)
    assert len({values["drift_rate"] for values in found["drawn"]}) == 8
