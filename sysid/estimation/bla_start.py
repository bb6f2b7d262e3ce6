"""A start of a fit from the best linear approximation of its record."""

import numpy as np

from sysid.base.errors import InputError
from sysid.data.record import IOData, siso
from sysid.diagnosis.bla import Parametric
from sysid.model.chain import Chain


def bla_start(chain: Chain, model: Parametric, data: IOData) -> np.ndarray:
    """theta (P,) for `sysid.fit(chain, data, start=...)`: its filter equals `model`, its maps are near identity.

    Raises InputError if the orders of the chain and the model differ.
    """
    linear = chain.linear
    if (linear.nb, linear.nf, linear.nk) != (len(model.b), len(model.f), model.nk):
        raise InputError(
            f"the chain has orders {linear.nb}, {linear.nf}, {linear.nk} and the approximation "
            f"{len(model.b)}, {len(model.f)}, {model.nk}; fit the approximation with the chain's orders"
        )
    x, _ = siso(data)
    theta = []
    for block in chain.blocks:
        if block is linear:
            own = np.concatenate([model.b, model.f, np.zeros(linear.n_parameters - linear.nb - linear.nf)])
        else:
            own = block.start(x)
        x = block.output(own, x)
        theta.append(own)
    return np.concatenate(theta)
