"""Named model recipes: one file with a function and its settings class, and one line in `TABLE`."""

from sysid.model.recipes import Recipe
from sysid.structures.actuated_joint import ActuatedJoint, actuated_joint
from sysid.structures.armax import Armax, armax
from sysid.structures.arx import Arx, arx
from sysid.structures.bj import BoxJenkins, bj
from sysid.structures.coupled_drives import CoupledDrives, coupled_drives
from sysid.structures.hammerstein import Hammerstein, hammerstein
from sysid.structures.hammerstein_wiener import HammersteinWiener, hammerstein_wiener
from sysid.structures.motor_profile import MotorProfile, motor_profile
from sysid.structures.nlarx import NonlinearArx, nlarx
from sysid.structures.output_error import OutputError, output_error
from sysid.structures.process import ProcessModel, process
from sysid.structures.servo_joint import ServoJoint, servo_joint
from sysid.structures.state_space import NonlinearStateSpace, state_space
from sysid.structures.wiener import Wiener, wiener
from sysid.structures.wiener_hammerstein import WienerHammerstein, wiener_hammerstein

TABLE: dict[str, type[Recipe]] = {
    "actuated_joint": ActuatedJoint,
    "armax": Armax,
    "arx": Arx,
    "bj": BoxJenkins,
    "coupled_drives": CoupledDrives,
    "hammerstein": Hammerstein,
    "hammerstein_wiener": HammersteinWiener,
    "motor_profile": MotorProfile,
    "nlarx": NonlinearArx,
    "output_error": OutputError,
    "process": ProcessModel,
    "servo_joint": ServoJoint,
    "state_space": NonlinearStateSpace,
    "wiener": Wiener,
    "wiener_hammerstein": WienerHammerstein,
}

__all__ = [
    "TABLE",
    "ActuatedJoint",
    "Armax",
    "Arx",
    "BoxJenkins",
    "CoupledDrives",
    "Hammerstein",
    "HammersteinWiener",
    "MotorProfile",
    "NonlinearArx",
    "NonlinearStateSpace",
    "OutputError",
    "ProcessModel",
    "Recipe",
    "ServoJoint",
    "Wiener",
    "WienerHammerstein",
    "actuated_joint",
    "armax",
    "arx",
    "bj",
    "coupled_drives",
    "hammerstein",
    "hammerstein_wiener",
    "motor_profile",
    "nlarx",
    "output_error",
    "process",
    "servo_joint",
    "state_space",
    "wiener",
    "wiener_hammerstein",
]
