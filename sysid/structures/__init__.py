"""Named model recipes: one file with a function and its settings class, and one line in `TABLE`."""

from sysid.model.recipes import Recipe
from sysid.structures.actuated_joint import ActuatedJoint, actuated_joint
from sysid.structures.hammerstein import Hammerstein, hammerstein
from sysid.structures.hammerstein_wiener import HammersteinWiener, hammerstein_wiener
from sysid.structures.nlarx import NonlinearArx, nlarx
from sysid.structures.output_error import OutputError, output_error
from sysid.structures.wiener import Wiener, wiener
from sysid.structures.wiener_hammerstein import WienerHammerstein, wiener_hammerstein

TABLE: dict[str, type[Recipe]] = {
    "actuated_joint": ActuatedJoint,
    "hammerstein": Hammerstein,
    "hammerstein_wiener": HammersteinWiener,
    "nlarx": NonlinearArx,
    "output_error": OutputError,
    "wiener": Wiener,
    "wiener_hammerstein": WienerHammerstein,
}

__all__ = [
    "TABLE",
    "ActuatedJoint",
    "Hammerstein",
    "HammersteinWiener",
    "NonlinearArx",
    "OutputError",
    "Recipe",
    "Wiener",
    "WienerHammerstein",
    "actuated_joint",
    "hammerstein",
    "hammerstein_wiener",
    "nlarx",
    "output_error",
    "wiener",
    "wiener_hammerstein",
]
