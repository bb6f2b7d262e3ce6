"""Methods of this library that fit the model which a reference record states."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.bench.certificate.record import chain_of
from sysid.bench.certificate.static import EXACT
from sysid.bench.contract import Data
from sysid.bench.method import FunctionMethod
from sysid.bench.methods.library import LibraryModel, record
from sysid.estimation.result import Fit
from sysid.fitting import fit


@dataclass(frozen=True)
class StatedModel(LibraryModel):
    """A fit that tells its parameters too."""

    @property
    def details(self) -> dict[str, Any]:
        """See `sysid.bench.contract.Model`."""
        assert isinstance(self.fit, Fit)
        free, names = self.fit.model.free, self.fit.model.names
        spread = self.fit.covariance.std()
        table = {"values": self.fit.theta, "deviations": spread}
        values = {key: {n: float(v[k]) for k, n in enumerate(names) if free[k]} for key, v in table.items()}
        return {"stop": self.fit.stop.reason, "loss": self.fit.criteria.mse, **values}


def stated(data: Data) -> Mapping[str, Any]:
    """The model that a record states. Raises InputError for a record of the benchmark, which states none."""
    if data.model is None:
        raise InputError("this record states no model; qpal bench certify has records that do")
    return data.model


def search_stated(data: Data) -> StatedModel:
    """The stated model from the record's start, searched to the last digit."""
    model, signals = stated(data), record(data)
    chain, values = chain_of(model), dict(model["fixed"]) | dict(model["start"])
    start = np.array([values[name] for name in chain.names])
    return StatedModel(fit(chain, signals, start=start, options=EXACT), signals)


def fit_stated(data: Data) -> StatedModel:
    """The stated model as `sysid.fit` does it by default: its own starts, its own tolerance."""
    signals = record(data)
    return StatedModel(fit(chain_of(stated(data)), signals, seed=data.seed), signals)


METHODS = (
    FunctionMethod("stated", "the stated model from the record's start, to the last digit", search_stated),
    FunctionMethod("stated_default", "the stated model, from starts and with tolerance of sysid.fit", fit_stated),
)
