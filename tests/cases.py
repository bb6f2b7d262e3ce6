"""One ready instance for each registered name; the contract tests run over these tables."""

import numpy as np

from sysid.blocks import (
    Channels,
    DeadZone,
    PiecewiseLinear,
    Polynomial,
    Saturation,
    SigmoidNetwork,
    TransferFunction,
    TransferMatrix,
    UnitGain,
)
from sysid.excitations import Aprbs, Sweep

# Block and parameters in the interior of its domain, for inputs in [-2, 2].
BLOCKS = {
    "channels": (
        Channels(maps=(Saturation(), Polynomial(degree=2)), role="map"),
        np.array([-1.1, 1.3, 0.3, 1.1, 0.4]),
    ),
    "dead_zone": (DeadZone(role="map"), np.array([-0.4, 0.7])),
    "piecewise_linear": (
        PiecewiseLinear(knots=5, role="map"),
        np.array([-1.7, -0.6, 0.1, 0.9, 1.6, -1.0, -0.9, 0.3, 0.4, 2.0]),
    ),
    "polynomial": (Polynomial(degree=3, role="map"), np.array([0.3, -0.2, 1.1, 0.4])),
    "saturation": (Saturation(role="map"), np.array([-1.1, 1.3])),
    "sigmoid_network": (
        SigmoidNetwork(units=3, role="map"),
        np.array([0.2, 0.7, 1.0, -0.8, 0.5, 3.0, 2.0, -4.0, 1.0, -0.5, 0.7]),
    ),
    "transfer_function": (
        TransferFunction(nb=2, nf=3, nk=2, role="map"),
        np.array([0.8, 0.5, -1.7, 1.0, -0.21, 0.3, -0.4, 0.2]),
    ),
    "transfer_matrix": (
        TransferMatrix(
            entries=(
                (TransferFunction(1, 1, 1), TransferFunction(2, 1, 0)),
                (TransferFunction(1, 2, 1), TransferFunction(1, 1, 2)),
            ),
            role="map",
        ),
        np.array([0.8, -0.6, 0.2, 0.5, 0.3, -0.8, 0.1, 0.9, -1.2, 0.5, 0.2, -0.3, 0.4, 0.55, 0.1, -0.2]),
    ),
    "unit_gain": (UnitGain(role="map"), np.empty(0)),
}
EXCITATIONS = {"aprbs": Aprbs(amplitude=3.0), "sweep": Sweep(amplitude=3.0, half_period=2.0)}
# Orders and maps for each structure.
STRUCTURES = {
    "hammerstein": {"input": "saturation"},
    "hammerstein_wiener": {"input": "saturation", "output": "polynomial"},
    "output_error": {},
    "wiener": {"output": "polynomial"},
}
