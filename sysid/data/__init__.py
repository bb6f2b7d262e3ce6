"""Records: `IOData` and preprocessing before a model is fitted."""

from sysid.base import modules_of
from sysid.data.frequency import FrequencyData, frequency_data
from sysid.data.preprocess import detrend, quick_start, retrend
from sysid.data.record import IOData

__all__ = ["FrequencyData", "IOData", "detrend", "frequency_data", "quick_start", "retrend"]

__getattr__, __dir__ = modules_of(__name__)
