"""The position loop of a servo as the controller of MuJoCo's dcmotor, and what that controller does otherwise."""

import numpy as np

from sysid.blocks import ServoMotor


def controller(motor: ServoMotor, own: np.ndarray, Ts: float, per_volt: float, speed: float) -> str:
    """Attributes of a dcmotor whose drive is that of the servo, clip(kp (goal - x) - kd v + i, -limit, limit).

    `own` are the parameters of the motor, `per_volt` [N m/V] the torque per drive, `speed` the speed per drive, with
    Ke = 1 / speed. MuJoCo's controller commands a torque and drives v = (R / K) torque + K speed (XML reference,
    dcmotor, controller); with K / R = per_volt its kd takes the K speed away again.
    """
    value = {slot.name: motor.value(own, slot.name) for slot in motor.slots()}
    kp, limit = value["kp"], value["limit"]
    kd, ki = value.get("kd", 0.0) * Ts, value.get("ki", 0.0) / Ts
    most = limit / ki if ki > 0.0 else 0.0
    numbers = (per_volt * kp, per_volt * ki, per_volt * (kd + 1.0 / speed), 0.0, most, limit)
    return f'input="pos" controller="{" ".join(f"{x:.9g}" for x in numbers)}"'


def missing_of_servo(motor: ServoMotor, own: np.ndarray) -> list[str]:
    """A sentence for each part of the loop that the controller does not have."""
    sentences = []
    if motor.value(own, "dead") > 0.0:
        sentences.append("the dead band of the loop around its goal: MuJoCo's controller acts on every error")
    if motor.value(own, "sag") > 0.0:
        sentences.append("sagging of the supply: the largest drive is constant")
    if motor.integrates:
        sentences.append("an integral that stands still at the largest drive: it is limited to that drive instead")
    if motor.held:
        sentences.append("a loop that acts once in a sample: MuJoCo's acts in each step of the simulation")
    if motor.scheduled:
        sentences.append("gains that differ by record: the elements have those of a factor of 1")
    return sentences
