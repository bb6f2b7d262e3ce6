"""A figure as data (`figure`), drawn with matplotlib (`axes`) and with plotly (`plotly`)."""

from sysid.base import modules_of

__getattr__, __dir__ = modules_of(__name__)
