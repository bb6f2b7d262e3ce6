"""A fit that starts from another one: static maps put around a linear model, or blocks taken over by their role."""

from dataclasses import replace
from typing import Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.rates import same_rate
from sysid.block.block import StaticBlock
from sysid.data.record import IOData, siso
from sysid.diagnosis.bla import Parametric
from sysid.estimation.fit import fit_chain
from sysid.estimation.guard import squared_errors
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.result import Fit
from sysid.estimation.starts._start import clip_to_bounds, start_maps
from sysid.model.chain import Chain

_ABOVE = 1.01  # times the errors of the fit that it starts from


@checked
def fit_from(fit: Fit, model: Chain, data: IOData, **options: Any) -> Fit:
    """Fit `model` to `data` from the blocks that it has in common with `fit`; `options` are those of `sysid.fit`.

    A block is common if its role and its parameters are: the linear model of an output-error fit starts a
    Hammerstein-Wiener model of the same orders. Static maps that `fit` has not start near a straight line, and as near
    one as they can; the better search is kept, so the errors are not above those of `fit`. Where the new model cannot
    be as `fit` is, as a saturation has no place for an offset, a warning says so. Raises InputError for a block without
    a start, for other orders, another sampling time and several channels, and the errors of `sysid.fit`.
    """
    for name in ("start", "starts"):
        if name in options:
            raise InputError(f"fit_from starts from the fit that it is given; leave {name} out, or use sysid.fit")
    chain, thetas = starting_thetas(fit, model, data)
    result = fit_chain(chain, data, start=thetas, **options)
    mse = squared_errors(fit.model, with_initial_states(fit.model, fit.theta, data), data) / max(data.observed.sum(), 1)
    if result.criteria.mse > _ABOVE * mse:
        warning = (
            f"the mean square error is {result.criteria.mse / mse:.3g} times that of the fit that this one starts "
            "from, as its maps have no place for what that fit has, such as an offset: take the means off the record "
            "(sysid.data.preprocess.detrend), or choose another map"
        )
        result = replace(result, warnings=(warning, *result.warnings))
    return result.remember(data)


def starting_thetas(fit: Fit, model: Chain, data: IOData) -> tuple[Chain, np.ndarray]:
    """The chain on the scale of the record, and its starting points theta (2, P): maps that bend, and straight ones."""
    if model.channels != (1, 1) or fit.model.channels != (1, 1):
        raise InputError("a fit of several inputs or outputs cannot start another model; use sysid.fit")
    if not same_rate(data.Ts, fit.Ts):
        raise InputError(f"the record is sampled every {data.Ts} s and the fit every {fit.Ts} s; resample it first")
    chain = model.scaled(data.u, data.y)
    thetas = with_initial_states(fit.model, fit.theta, data)
    return chain, np.array([_starting_theta(fit, thetas, chain, data, straight) for straight in (False, True)])


def _starting_theta(fit: Fit, thetas: np.ndarray, chain: Chain, data: IOData, straight: bool) -> np.ndarray:
    """theta (P,) of the first experiment; thetas (K, P) are the fit's, with the initial states of each experiment."""
    theta = np.zeros(len(chain.names))
    x, y = data.u[:, 0], data.y[:, 0]
    behind = False  # whether a block with memory lies before this one
    for block in chain.blocks:
        source = fit.model.block(block.role)
        names = [slot.name for slot in block.slots()]
        if source is not None and type(source) is type(block) and names == [slot.name for slot in source.slots()]:
            parts = [fit.model.part(row, source) for row in thetas]
        elif isinstance(block, StaticBlock):
            start_maps(chain, theta, (block,), x, x + float(np.mean(y - x)) if behind else x, straight)
            parts = [theta[chain.index(block)]] * len(thetas)
        else:
            raise InputError(
                f"block {block.role!r} of the model is not in the fit with the same orders; give the model the orders "
                "of the fit, or use sysid.fit"
            )
        theta[chain.index(block)] = parts[0]
        pieces = np.split(x, np.cumsum(data.lengths)[:-1])
        x = np.concatenate([block.output(part, piece) for part, piece in zip(parts, pieces, strict=True)])
        behind = behind or not isinstance(block, StaticBlock)
    return clip_to_bounds(chain, theta)


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
            part = np.concatenate([model.b, model.f, np.zeros(linear.n_parameters - linear.nb - linear.nf)])
        else:
            part = block.start(x)
        x = block.output(part, x)
        theta.append(part)
    return np.concatenate(theta)
