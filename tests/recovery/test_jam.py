"""A motor that jams at a stop, against a motion worked out by hand: settled speed, strike, wait, first-order lag."""

import numpy as np
import pytest

from sysid.blocks import Motor

GAIN, LAG, RISE, FALL, UPPER = 0.002, 0.5, 1.5, 2.0, 1.0
START = 0.137  # so that no stop is struck just at a sample
FRICTION = {1: RISE, -1: FALL}
MOTOR = Motor(load=0, jams=True, delayed=False)


def run(u: np.ndarray, jam: float, start: float, motor: Motor = MOTOR, **more: float) -> np.ndarray:
    """Position (N,) under u (N,) [V], from rest at `start`."""
    known = {"gain": GAIN, "lag": LAG, "rise": RISE, "fall": FALL, "jam": jam, "upper": UPPER, "x0": start, **more}
    theta = np.array([known.get(slot.name, 0.0) for slot in motor.slots()])
    return motor.propagate(theta, np.ascontiguousarray(u), np.empty((len(u), 0)), 0)


def speed(volts: float, direction: int) -> float:
    """Speed [strokes a sample] that `volts` give in the end."""
    return GAIN * (volts - FRICTION[direction])


def way(volts: float, direction: int, t: np.ndarray) -> np.ndarray:
    """Way after t [samples] of `volts` from rest; none before."""
    t = np.maximum(t, 0.0)
    return direction * speed(volts, direction) * (t - LAG * (1.0 - np.exp(-t / LAG)))


def there_and_back(direction: int, volts: float, jam: float, rest: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """u and expected position (N,) of a run to a stop and back, `rest` samples after the strike, and its distances.

    The lag has settled long before the strike, and 12 V back come early enough to be waited for.
    """
    v, begins = speed(volts, direction), START if direction > 0 else UPPER - START
    stop = UPPER if direction > 0 else 0.0
    strikes = abs(stop - begins) / v + LAG
    turned = int(np.ceil(strikes)) + rest
    leaves = max(strikes + jam * v, turned)
    t = np.arange(int(leaves) + 40, dtype=float)  # it is on its way back then
    u = np.where(t < turned, direction * volts, -direction * 12.0)
    there = np.where(t < strikes, begins + way(volts, direction, t), stop)
    expected = np.where(t > leaves, stop + way(12.0, -direction, t - leaves), there)
    return u, expected, t - leaves


@pytest.mark.parametrize("jam", [0.0, 300.0, 1665.0])
@pytest.mark.parametrize("volts", [3.7, 6.0, 8.3, 12.0])
@pytest.mark.parametrize("direction", [1, -1])
def test_a_struck_stop_keeps_the_motor_for_jam_times_speed_and_no_longer(
    direction: int, volts: float, jam: float
) -> None:
    u, expected, since = there_and_back(direction, volts, jam, rest=0)
    begins, stop = (START, UPPER) if direction > 0 else (UPPER - START, 0.0)
    x = run(u, jam, begins)
    # exp(-samples / lag) is what is left of the lag at the strike: below rounding in all these runs.
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-12)
    assert np.all(x[(since <= 0.0) & (since > -min(jam * speed(volts, direction), 1.0))] == stop)
    assert np.all(x[since > 0.0] != stop)


@pytest.mark.parametrize("rest", [1, 3, 10])
def test_a_jam_is_over_with_its_time_whatever_is_asked_of_the_motor_meanwhile(rest: int) -> None:
    u, expected, _ = there_and_back(1, 9.0, jam=300.0, rest=rest)  # 4.5 samples from the strike
    np.testing.assert_allclose(run(u, 300.0, START), expected, rtol=0, atol=1e-12)


def test_a_delayed_input_meets_the_same_jam() -> None:
    late = 0.3
    u, _, _ = there_and_back(1, 6.0, jam=500.0, rest=0)
    # Before the record its first input stood: the motor starts at once, and turns 0.3 samples late.
    strikes = (UPPER - START) / speed(6.0, 1) + LAG
    leaves = max(strikes + 500.0 * speed(6.0, 1), int(np.ceil(strikes)) + late)
    t = np.arange(len(u), dtype=float)
    expected = np.where(t < strikes, START + way(6.0, 1, t), UPPER) + way(12.0, -1, t - leaves)
    shown = run(u, 500.0, START, Motor(load=0, jams=True), delay=late)
    np.testing.assert_allclose(shown, expected, rtol=0, atol=1e-12)


def test_a_motor_that_begins_at_its_stop_has_not_struck_it() -> None:
    t = np.arange(40, dtype=float)
    u = np.where(t < 10, 12.0, -12.0)  # pressed against the stop first
    np.testing.assert_allclose(run(u, 500.0, UPPER), UPPER + way(12.0, -1, t - 10.0), rtol=0, atol=1e-12)


def test_every_strike_jams_anew() -> None:
    jam, up, down, begins = 500.0, speed(12.0, 1), speed(12.0, -1), 0.6
    back, again, N = 22, 52, 120  # when it is asked to go back, and up once more
    leaves = (UPPER - begins) / up + LAG + jam * up
    # Moving down it is braked by friction too: a lag from -down towards gain (12 V + fall), until it stands.
    braked = GAIN * (12.0 + FALL)
    stands = again + LAG * np.log((braked + down) / braked)
    lowest = UPPER + way(12.0, -1, np.array([again - leaves]))[0] + braked * (stands - again) - LAG * down
    strikes = stands + (UPPER - lowest) / up + LAG
    turned = int(np.ceil(strikes))
    assert back < leaves < again < turned < strikes + jam * up < N - 20
    t = np.arange(N, dtype=float)
    first = np.minimum(begins + way(12.0, 1, t), UPPER) + way(12.0, -1, t - leaves)
    second = np.minimum(lowest + way(12.0, 1, t - stands), UPPER) + way(12.0, -1, t - strikes - jam * up)
    u = np.where((t < back) | ((t >= again) & (t < turned)), 12.0, -12.0)
    told = (t <= again) | (t >= stands)
    x = run(u, jam, begins)
    np.testing.assert_allclose(x[told], np.where(t <= again, first, second)[told], rtol=0, atol=1e-12)
