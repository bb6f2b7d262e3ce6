"""From a file of frequency response data to a fitted model, as in `qpal identify`."""

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.files import json_value
from sysid.base.poles import time_constant
from sysid.channels.frequency import frequency_of
from sysid.data.frequency import FrequencyData
from sysid.data.record import IOData
from sysid.estimation.frequency_fit import ResponseFit, fit_response
from sysid.formats import read_table
from sysid.formats.delimited import Delimited
from sysid.joint.values import JointValue
from sysid.model.recipes import Recipe
from sysid.model.tangents import tangent
from sysid.structures import OutputError, ProcessModel
from sysid.uncertainty.responses import normal_quantile
from sysid.workflow.named_values import unit_of
from sysid.workflow.setting import Setting

_LARGEST = 2_000_000  # bytes: some 20,000 frequencies, many more than analysers write


@dataclass(frozen=True)
class FrequencyIdentification:
    """The data of one file, the setting, the fit, and its values with 95 % intervals."""

    path: Path
    data: FrequencyData
    setting: Setting
    result: ResponseFit
    values: tuple[JointValue, ...]

    def as_dict(self) -> dict[str, Any]:
        """A summary ready for JSON."""
        r, fit = self.result, self.result.fit
        return json_value(
            {
                "file": str(self.path),
                "kind": "frequency response",
                "frequencies": {"number": len(self.data.w), "low": self.data.w[0], "high": self.data.w[-1]},
                "setting": self.setting.as_dict(),
                "error": {"share_of_response": r.share, "deviations": r.errors, "excess": r.excess, "random": r.random},
                "values": [vars(value) for value in self.values],
                **{name: value for name, value in fit.summary().items() if name != "structure"},
            }
        )


def read_frequency(
    path: str | os.PathLike[str], Ts: float | None = None, is_record: bool = False
) -> FrequencyData | None:
    """The frequency response in a file; None if it holds none, whatever else it holds or lacks.

    A larger file is a log, which is not read twice. Raises InputError for one that lacks something, which is none where
    who asks knows that it `is_record`.
    """
    try:
        if Path(path).suffix.lower() not in Delimited.suffixes or Path(path).stat().st_size > _LARGEST:
            return None
        table = read_table(path)
    except (InputError, OSError):
        return None  # told by who reads a record
    try:
        return frequency_of(table, Ts)
    except InputError:
        if is_record:
            return None
        raise


def identify_frequency(path: str | os.PathLike[str], data: FrequencyData, setting: Any) -> FrequencyIdentification:
    """The fit to the frequency response of a file.

    Raises InputError, with the file's name, for structures other than process and output_error.
    """
    name = Path(path)
    if not isinstance(setting, Setting) or not isinstance(setting.recipe, OutputError | ProcessModel):
        raise InputError(
            f"{name} holds a frequency response; fit it with --structure process, or with --structure output_error and "
            "--ts S where it is one of samples"
        )
    try:
        model = replace(setting.recipe, offset="none").model().sampled(data.Ts or float(np.pi / data.w[-1]))
        model, start = setting.held.apply(model, IOData(np.zeros(2), np.zeros(2)))
        result = fit_response(model, data, setting.search, start=start)
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    return FrequencyIdentification(name, data, setting, result, values(result, setting.recipe))


def values(result: ResponseFit, recipe: Recipe, level: float = 0.95) -> tuple[JointValue, ...]:
    """Gain, time constants and whatever else engineers name of the model, with intervals."""
    fit, factor = result.fit, normal_quantile(result, level)
    std, found = fit.covariance.std(), []
    for k, slot in enumerate(fit.model.slots):
        if not slot.words:
            continue
        value, unit = float(fit.theta[k]), unit_of(slot.unit, result.data)
        if not fit.model.free[k]:
            found.append(JointValue(slot.words, value, value, value, unit))
        elif np.isfinite(std[k]):
            low, high = max(value - factor * std[k], slot.lower), min(value + factor * std[k], slot.upper)
            found.append(JointValue(slot.words, value, low, high, unit))
        else:
            found.append(JointValue(slot.words, value, None, None, unit, False, "the data do not determine it"))
    return tuple(found) or _of_samples(result, factor)


def _of_samples(result: ResponseFit, factor: float) -> tuple[JointValue, ...]:
    """The gain and the time constants of a transfer function in samples."""
    fit, found = result.fit, []
    G = tangent(fit.model, fit.theta)
    if np.isfinite(G.gain):
        half = factor * fit.covariance.deviation(G.gain_gradient)
        found.append(JointValue("gain", G.gain, G.gain - half, G.gain + half, unit_of("Y/U", result.data)))
    for z, std in zip(fit.poles.tolist(), fit.pole_std.tolist(), strict=True):
        size = [time_constant(abs(z) + k * factor * std, fit.Ts) for k in (-1.0, 0.0, 1.0)]
        if z.imag >= 0.0:
            low, high = (None, None) if not np.isfinite(std) else (size[0], size[2])
            found.append(JointValue("time constant", size[1], low, high, "s", low is not None))
    return tuple(found)
