"""Physical models of three public records, and how each was chosen on its training record alone.

`PHYSICAL` maps a record to its models: each takes the training record in its own scale and gives a fit.
"""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

import sysid
from sysid import IOData
from sysid.blocks import Custom, FrictionLag, Motor, ProfiledMotor, TransferFunction
from sysid.data.gain_variants import gain_variants
from sysid.estimation.result import Fit
from sysid.estimation.starts.profile import first_state
from sysid.model.chain import Chain
from sysid.structures import actuated_joint

FULL_DUTY = 885.0  # of an XL330's PWM, 100 % (ROBOTIS e-manual, XL330-M288-T, "Present PWM")
SERVO_TS = 0.005  # s; the logs come at 4 to 6 ms

# A five-parameter friction model fitted to each quarter of the EMPS training record scatters by 1.5 % (standard
# deviation) in friction: what one record can say of another day is twice that.
EMPS_SHARE = 0.03
# Fitted to one half of the training record and run freely over the other, with the gain off by that share either way,
# 1, 2, 3, 5, 7, 9, 11, 13, 17, 21 and 25 knots leave 8.7, 7.9, 7.0, 4.6, 4.5, 4.8, 4.6, 5.3, 3.4, 3.6 and 3.2 mm: 17
# are the fewest within 5 % of the least.
EMPS_KNOTS = 17
EMPS_WAY = (0.0, 246.0)  # mm, of the guide


def held_state(train: IOData) -> dict[str, float]:
    """A motor's first position and speed, read off the record's first samples and held."""
    x0, v0 = first_state(train.y[:, 0])
    return {"motor.x0": x0, "motor.v0": v0}


def emps_motor(train: IOData) -> Fit:
    """Inertia, drag, dry friction each way: seven parameters, two of them the held state."""
    model = actuated_joint(
        motor=Motor(stops=False, delayed=False), knots=None, play=False, fixed=held_state(train) | {"motor.load0": 0.0}
    )
    return sysid.fit(model, gain_variants(train, EMPS_SHARE), starts=3)


def emps_profile(train: IOData, knots: int = EMPS_KNOTS, share: float = EMPS_SHARE) -> Fit:
    """The same with drag and dry friction each way, friction a free function of position.

    Made to predict, not to be read: the fit trades dry friction for drag, since drag forgives a wrong gain.
    """
    model = Chain((ProfiledMotor(knots, *EMPS_WAY, role="motor"),), fixed=held_state(train))
    return sysid.fit(model, gain_variants(train, share), starts=1)


def coupled_drives(orders: tuple[int, int, int] = (2, 2, 1)) -> tuple[Chain, np.ndarray]:
    """Chain of the coupled drives and a point to start from.

    Voltage, its gain bowed -> drive with dry friction -> belt on springs (two poles) -> rectifier, offset -> filter.
    Of 24 chains (one or two zeros, delay 0 or 1, each of bow, offset and filter there or not) it has the least BIC on
    the training records; every one was searched from four points. The drive's gain is held: the belt has one.
    """
    bow = Custom(
        lambda x, p: x * (1.0 + p[0] * np.abs(x)),
        ("bow",),
        (0.05,),
        slope=lambda x, p: 1.0 + 2.0 * p[0] * np.abs(x),
        jacobian=lambda x, p: (x * np.abs(x))[:, None],
        role="driver",
    )
    rectifier = Custom(
        lambda x, p: np.abs(x) + p[0],
        ("zero",),
        (-0.05,),
        slope=lambda x, p: np.sign(x),
        jacobian=lambda x, p: np.ones((len(x), 1)),
        role="rectifier",
    )
    nb, nf, nk = orders
    belt, sensor = TransferFunction(nb, nf, nk, role="belt"), TransferFunction(1, 1, 0, role="sensor")
    chain = Chain((bow, FrictionLag(role="drive"), belt, rectifier, sensor), fixed={"drive.gain": 0.15})
    own = [[0.05], [0.15, 0.05, 0.1, 0.6, 0.05], [0.05 / nb] * nb + [-1.75, 0.8] + [0.0] * belt.n_state]
    return chain, np.concatenate([*own, [-0.05], [0.5, -0.5], np.zeros(sensor.n_state)])


def ced_drives(train: IOData, starts: int = 4, seed: int = 0) -> Fit:
    """The best of some searches from varied points: drive, belt gain and sensor offset within 30 %."""
    chain, start = coupled_drives()
    rng = np.random.default_rng(seed)
    still = np.array([name.startswith(("belt.f", "sensor")) or name == "drive.gain" for name in chain.names])
    spread = np.where(still, 0.0, 0.3)
    points = [start] + [start * np.exp(spread * rng.normal(size=len(start))) for _ in range(starts - 1)]
    return min((sysid.fit(chain, train, start=point) for point in points), key=lambda fit: fit.criteria.loss)


def servo_logs(folder: Path) -> list[tuple[int, str, IOData]]:
    """Gain kp, trajectory and record of every log: volts (duty times supply) to angle [rad], on an even grid.

    A log ends where its torque is switched off: a motor without terminals is another plant.
    """
    logs = []
    for path in sorted(folder.glob("*.json")):
        log = json.loads(path.read_text())
        keys = ("timestamp", "position", "load", "input_volts", "torque_enable")
        t, y, duty, supply, on = (np.array([entry[k] for entry in log["entries"]], dtype=float) for k in keys)
        n = len(t) if on.all() else int(on.argmin())
        volts = np.where(duty > 32767.0, duty - 65536.0, duty) / FULL_DUTY * supply  # the register is a signed word
        grid = np.arange(t[0], t[n - 1], SERVO_TS)
        record = IOData(np.interp(grid, t[:n], volts[:n]), np.interp(grid, t[:n], y[:n]), SERVO_TS)
        logs.append((int(log["kp"]), str(log["trajectory"]), record))
    return logs


def servo_joint(train: IOData) -> Fit:
    """Motor whose gear loses a share of the load, the pendulum's pull a parabola over angle: least BIC of six."""
    motor = Motor(load=3, loss=True, stops=False, at=0.0)
    return sysid.fit(actuated_joint(motor=motor, knots=None, play=False), train)


def servo_grown(train: IOData) -> Fit:
    """What BIC adds to a plain motor on the training records; on the test records it loses to `servo_joint`."""
    plain = actuated_joint(motor=Motor(load=3, stops=False, at=0.0), knots=None, play=False)
    return sysid.grow_joint(train, plain).fit


def servo_profile(train: IOData) -> Fit:
    """Pull and friction free functions of angle; nine knots, an eighth of the stroke each."""
    low, high = float(train.y.min()), float(train.y.max())
    return sysid.fit(Chain((ProfiledMotor(9, low, high, role="motor"),)), train, starts=1)


PHYSICAL: dict[str, dict[str, Callable[[IOData], Fit]]] = {
    "emps": {"joint": emps_motor, "joint, profile": emps_profile},
    "ced": {"drives": ced_drives},
    "bam_xl330": {"joint": servo_joint, "joint, grown": servo_grown, "joint, profile": servo_profile},
}
