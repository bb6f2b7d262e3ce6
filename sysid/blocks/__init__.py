"""The blocks of a chain: one file, one class, one line in `TABLE`; `STATIC` are the maps that users choose by name."""

from collections.abc import Callable
from dataclasses import replace

from sysid.base.checks import checked
from sysid.base.errors import unknown
from sysid.block.block import Block, StaticBlock
from sysid.blocks._predictor import Predictor
from sysid.blocks.bowed_gain import BowedGain
from sysid.blocks.box_jenkins import BoxJenkins
from sysid.blocks.channels import Channels
from sysid.blocks.coasting_play import CoastingPlay
from sysid.blocks.compliance import Compliance
from sysid.blocks.cubic_spline import CubicSpline
from sysid.blocks.custom import Custom
from sysid.blocks.dead_zone import DeadZone
from sysid.blocks.dead_zone_saturation import DeadZoneSaturation
from sysid.blocks.delay import Delay
from sysid.blocks.dynamic import Dynamic, dynamic
from sysid.blocks.friction_lag import FrictionLag
from sysid.blocks.innovations import Innovations
from sysid.blocks.limited_integrator import LimitedIntegrator
from sysid.blocks.linkage import Linkage
from sysid.blocks.motor import Motor
from sysid.blocks.offset import Offset
from sysid.blocks.piecewise_linear import PiecewiseLinear
from sysid.blocks.play import Play
from sysid.blocks.polynomial import Polynomial
from sysid.blocks.process import Process
from sysid.blocks.profiled_motor import ProfiledMotor
from sysid.blocks.quantiser import Quantiser
from sysid.blocks.rectifier import Rectifier
from sysid.blocks.saturation import Saturation
from sysid.blocks.servo_motor import ServoMotor
from sysid.blocks.sigmoid_network import SigmoidNetwork
from sysid.blocks.state_space import StateSpace
from sysid.blocks.transfer_function import TransferFunction
from sysid.blocks.transfer_matrix import TransferMatrix
from sysid.blocks.travel_map import Travel, TravelMap
from sysid.blocks.unit_gain import UnitGain
from sysid.blocks.wavelet_network import WaveletNetwork
from sysid.blocks.wrap import Wrap

STATIC: dict[str, Callable[..., StaticBlock]] = {
    "cubic_spline": CubicSpline,
    "dead_zone": DeadZone,
    "dead_zone_saturation": DeadZoneSaturation,
    "piecewise_linear": PiecewiseLinear,
    "polynomial": Polynomial,
    "saturation": Saturation,
    "sigmoid_network": SigmoidNetwork,
    "unit_gain": UnitGain,
    "wavelet_network": WaveletNetwork,
}
TABLE: dict[str, Callable[..., Block]] = {
    **STATIC,
    "bowed_gain": BowedGain,
    "box_jenkins": BoxJenkins,
    "channels": Channels,
    "coasting_play": CoastingPlay,
    "compliance": Compliance,
    "custom": Custom,
    "delay": Delay,
    "dynamic": Dynamic,
    "friction_lag": FrictionLag,
    "innovations": Innovations,
    "limited_integrator": LimitedIntegrator,
    "linkage": Linkage,
    "motor": Motor,
    "offset": Offset,
    "play": Play,
    "process": Process,
    "profiled_motor": ProfiledMotor,
    "quantiser": Quantiser,
    "rectifier": Rectifier,
    "servo_motor": ServoMotor,
    "state_space": StateSpace,
    "transfer_function": TransferFunction,
    "transfer_matrix": TransferMatrix,
    "travel_map": TravelMap,
    "wrap": Wrap,
}


@checked(late=True)
def static(kind: "str | StaticBlock", role: str) -> StaticBlock:
    """The static map called `kind`, or the given map, in its role in the chain."""
    if isinstance(kind, StaticBlock):
        return replace(kind, role=role)
    if kind not in STATIC:
        raise unknown(f"{role} map", kind, STATIC)
    return STATIC[kind](role=role)


__all__ = [
    "STATIC",
    "TABLE",
    "BowedGain",
    "BoxJenkins",
    "Channels",
    "CoastingPlay",
    "Compliance",
    "CubicSpline",
    "Custom",
    "DeadZone",
    "DeadZoneSaturation",
    "Delay",
    "Dynamic",
    "FrictionLag",
    "Innovations",
    "LimitedIntegrator",
    "Linkage",
    "Motor",
    "Offset",
    "PiecewiseLinear",
    "Play",
    "Polynomial",
    "Predictor",
    "Process",
    "ProfiledMotor",
    "Quantiser",
    "Rectifier",
    "Saturation",
    "ServoMotor",
    "SigmoidNetwork",
    "StateSpace",
    "TransferFunction",
    "TransferMatrix",
    "Travel",
    "TravelMap",
    "UnitGain",
    "WaveletNetwork",
    "Wrap",
    "dynamic",
    "static",
]
