"""The simulated plant: MuJoCo's leg with the compiled motor board in every step."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)
