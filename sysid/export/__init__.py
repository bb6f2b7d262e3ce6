"""A fit as other people's code: C99, FMU, Python, MATLAB, ONNX, Modelica, MJCF, closed form."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)
