"""The plant as it is stepped: MuJoCo's leg with the motor board compiled into every step."""

from sysid.base.room import modules_of

__getattr__, __dir__ = modules_of(__name__)
