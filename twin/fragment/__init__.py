"""Elements of an identified joint in MuJoCo: checked against the fit, and put into a model of the user's."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)
