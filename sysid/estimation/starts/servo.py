"""Starts of a servo joint from the record: bandwidth of its loop, largest speed, friction, lag and load."""

from itertools import product

import numpy as np

from sysid.block.block import Block
from sysid.blocks import Play, ServoMotor
from sysid.data.record import IOData
from sysid.estimation.joint_parts import differ_in_motor, free_run_cost, motor_of
from sysid.estimation.starts._start import Start, longest
from sysid.model.chain import Chain

# Chosen by hand.
_TRIED = 80  # candidates a start that is asked for
_SAMPLES = 1500  # of the record that a candidate runs over
_RATES = np.geomspace(0.01, 1.0, 13)  # of the loop, per sample
_DELAYS = (0, 1, 2, 4)  # samples


class Servo(Start):
    """A chain with a `ServoMotor`: the best of many random candidates in free run.

    A first-order lag fitted to goal and angle gives the rate of the loop; a candidate is that rate, the share of full
    speed that the record shows, friction, lag and load drawn around it.
    """

    blocks = (ServoMotor,)

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        record = longest(data)
        u, y = record.u[:_SAMPLES], record.y[:_SAMPLES, 0]
        goal = u[:, 0] if chain.blocks[0] is motor_of(chain) else y  # ahead of a command map the scale is another
        rate, delay = _first_order(goal, y)
        rng = np.random.default_rng([seed, 11])
        draws = [_draw(chain, u, goal, y, rate, delay, None if k == 0 else rng) for k in range(_TRIED * count)]
        costs = np.array([free_run_cost(chain, theta, u, y) for theta in draws])
        order = np.argsort(costs, kind="stable")
        numbers: list[int] = []
        for k in order:
            if all(differ_in_motor(chain, draws[k], draws[j]) for j in numbers):
                numbers.append(int(k))
            if len(numbers) == count:
                break
        numbers += [int(k) for k in order if k not in numbers][: count - len(numbers)]
        return [draws[k] for k in numbers]


def _first_order(goal: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Rate [1/sample] and delay [samples] of the first-order lag from goal to y with the smallest error."""
    best, best_pair = np.inf, (0.1, 0.0)
    for rate, delay in product(_RATES, _DELAYS):
        target_delayed = np.concatenate([np.full(delay, goal[0]), goal[: len(goal) - delay]])
        run, decay, value = np.empty_like(y), float(np.exp(-rate)), float(y[0])
        for t, target in enumerate(target_delayed):
            run[t] = value
            value = target + (value - target) * decay
        cost = float(np.sum((y - run) ** 2))
        if cost < best:
            best, best_pair = cost, (float(rate), float(delay))
    return best_pair


def _draw(
    chain: Chain,
    u: np.ndarray,
    goal: np.ndarray,
    y: np.ndarray,
    rate: float,
    delay: float,
    rng: np.random.Generator | None,
) -> np.ndarray:
    """One candidate; the first is the simplest."""
    motor, theta = motor_of(chain), np.zeros(len(chain.names))
    for b in chain.blocks:
        theta[chain.index(b)] = _values(b, u, y)
    values = _physics(chain, goal, y, rate, delay, rng)
    factor = float(u[0, 1]) if u.shape[1] > 1 else 1.0
    for name in ("kp", "kd", "ki"):
        values[name] /= max(abs(factor), 1e-12)
    theta[chain.index(motor)] = [values.get(slot.name, 0.0) for slot in motor.slots()]
    for i, (name, slot) in enumerate(zip(chain.names, chain.slots, strict=True)):
        theta[i] = chain.fixed.get(name, float(np.clip(theta[i], slot.lower, slot.upper)))
    return theta


def _physics(
    chain: Chain, goal: np.ndarray, y: np.ndarray, rate: float, delay: float, rng: np.random.Generator | None
) -> dict[str, float]:
    """The motor's parameters by name."""
    motor = motor_of(chain)
    assert isinstance(motor, ServoMotor)
    fastest = float(np.quantile(np.abs(np.diff(y)), 0.99)) or 1e-9
    limit = chain.fixed.get(f"{motor.role}.limit", 1.0)
    reserve, haste, friction, tilt, load, lag, stick, damping, delay_error = (
        1.3,
        1.0,
        0.05,
        0.0,
        0.0,
        1.0,
        0.2,
        0.3,
        0.0,
    )
    if rng is not None:
        reserve = float(np.exp(rng.uniform(*np.log([0.8, 5.0]))))
        haste = float(np.exp(rng.uniform(*np.log([0.5, 4.0]))))
        friction = float(np.exp(rng.uniform(*np.log([0.005, 0.3]))))
        tilt, load = rng.uniform(-0.3, 0.3), 0.15 * rng.normal()
        lag = float(np.exp(rng.uniform(*np.log([0.1, 1.5]))))
        stick, damping, delay_error = rng.uniform(0.0, 0.6), rng.uniform(0.0, 1.0), rng.uniform(-0.5, 1.5)
    gain = reserve * fastest / limit
    kp = chain.fixed.get(f"{motor.role}.kp", haste * rate / gain)
    if f"{motor.role}.kp" in chain.fixed and rng is None:
        gain = haste * rate / kp
    dry = friction * limit
    span = max(float(np.ptp(y)), 1e-12)
    return {
        "kp": kp,
        "kd": damping / gain,
        "ki": 0.1 * kp * rate,
        "dead": 0.002 * span,
        "sag": 0.1,
        "limit": limit,
        "gain": gain,
        "lag": lag / rate,
        "rise": dry * (1.0 + tilt),
        "fall": dry * (1.0 - tilt),
        "stick": dry * stick,
        "stick_down": dry * stick,
        "stick_speed": 0.03 * fastest,
        "load1": load * limit / span,
        "loss": 0.1,
        "delay": max(delay + delay_error, 0.0),
        "lower": float(y.min()) - 0.1 * span,
        "upper": float(y.max()) + 0.1 * span,
        "x0": float(y[: min(3, len(y))].mean()),
    }


def _values(b: Block, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    part = b.start(u[:, 0] if b.role == "command" else y)
    if isinstance(b, Play):
        part[0] = 0.005 * float(np.ptp(y))
    return part
