"""More friction at low speed."""

from typing import ClassVar

from twin.imperfections._declaration import Imperfection


class Stribeck(Imperfection):
    """With its rows at 0 the leg does not have it."""

    name, group = "stribeck", "friction"
    title = "More friction at low speed"
    about = "Surfaces touch at rest; in motion a lubricant film separates them."
    model = (
        "(1 + stribeck exp(−(v / stribeck_speed)²)) times Coulomb friction (Olsson, Åström, Canudas de Wit, Gäfvert "
        "and Lischinsky, Friction models and friction compensation, European Journal of Control 4, 1998, eq. 4)."
    )
    parameters = "`JOINT.stribeck`, `JOINT.stribeck_speed`."
    remark = (
        "With nominal parameters friction falls less steeply with speed than the back-EMF braking rises (thigh and "
        "shank), or hardly more (shoulder). A joint driven by a voltage therefore starts almost without a jump. A "
        "position loop with an integral gain and more static friction does not come to rest (here `JOINT.servo_ki` "
        "150, `JOINT.servo_kp` 30, `JOINT.stribeck` 1; why: Armstrong-Hélouvry, Dupont and Canudas de Wit, "
        "Automatica 30, 1994, section 4). Each slip begins where the motor's torque reaches the static friction."
    )
    ideal: ClassVar = {"JOINT.stribeck": 0.0}
    joint: ClassVar = {"STRIBECK": "JOINT.stribeck", "STRIBECK_SPEED": "JOINT.stribeck_speed"}
