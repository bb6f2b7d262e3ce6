"""Which end stops a record shows: none, the lower, the upper, or both, each fitted and each to be earned."""

from dataclasses import replace
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.blocks import Motor, ServoMotor, Travel, TravelMap
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.joint_parts import lift_theta, motor_of, sub
from sysid.estimation.result import Fit
from sysid.estimation.starts.joint import Joint
from sysid.joint.full import rough_posterior, with_turns
from sysid.joint.holdout import holdout_errors, is_harmful
from sysid.joint.physics import travel_of
from sysid.joint.stops import drive_sign
from sysid.model.chain import Chain
from sysid.selection.folds import Fold
from sysid.solver.iterate import Options

# The choices from the simplest, and how many stops each has.
ENDS: dict[str, int] = {"straight": 0, "none": 0, "lower": 1, "upper": 1, "both": 2}
WORDS = {
    "straight": "no end stop and a straight linkage",
    "none": "no end stop",
    "lower": "the lower end stop alone",
    "upper": "the upper end stop alone",
    "both": "both end stops",
}
_SCREENING = Options(max_iterations=40)
_OWN_STARTS = 1  # starts of its own for a joint with fewer stops, besides the optimum with both
# Three times what counts as very strong evidence (Kass and Raftery, J. Amer. Statist. Assoc. 90, 1995, section 3.2):
# residuals of a model that is not quite the joint are coloured, and BIC takes them as white.
MARGIN = 30.0
_DOUBT = 20.0  # margins of BIC within which a joint without stops gets more starts
_NEARLY_AS_GOOD = (
    0.5  # of BIC a sample: twice the logarithm of the error's ratio, within which joints are nearly as good
)
_CLEAR_MARGINS = (
    5.0  # margins beyond which a stop need not show on unseen folds: one that is struck once is in one fold alone
)


def variant(chain: Chain, choice: str, low: float, high: float) -> Chain:
    """The joint with these end stops; `low` and `high` [y] are the outputs at 0 and 1 strokes.

    Where a stop is left out, the output at that end of the linkage only sets the scale of a stroke, and is held; where
    the linkage is, the motor's place is that of the output, and its middle the middle between them.
    """
    motor = motor_of(chain)
    if choice == "both":
        return chain
    fewer = replace(motor, stops=choice if choice in ("lower", "upper") else False)
    blocks, travel = tuple(fewer if b is motor else b for b in chain.blocks), travel_of(chain)
    if travel is None or travel.is_line:
        return sub(chain, blocks)
    held = {"lower": {"map.high": high}, "upper": {"map.low": low}}.get(choice, {"map.low": low, "map.high": high})
    if choice == "straight":
        straight = (TravelMap(2, role=travel.role),) if low > high else ()
        fewer = fewer if straight else replace(fewer, at=0.5 * (low + high))
        blocks = tuple(fewer if b is motor else b for b in chain.blocks)
        blocks = tuple(line for b in blocks for line in (straight if b is travel else (b,)))
        held = held if straight else {}
    return sub(chain, blocks, held)


def straight_for(chain: Chain, data: IOData) -> Chain:
    """A joint without linkage, with a straight one that falls where the output falls as the voltage rises.

    The motor's position then rises with the voltage, as everywhere; it is in strokes of the way in the record, which
    the period of a load is divided by. A chain with parameters that the user holds or bounds keeps its units.
    """
    motor, k = motor_of(chain), chain.blocks.index(motor_of(chain))
    y = data.y[data.observed[:, 0], 0]
    way, held = float(np.ptp(y)), {f"{motor.role}.{name}": 0.0 for name in ("v0", "load0")}
    own = {name: value for name, value in {**chain.fixed, **chain.bounds}.items() if name.startswith(f"{motor.role}.")}
    free = all(name in held or (name.endswith(".load1") and value[0] == 0.0) for name, value in own.items())
    falls = sum(drive_sign(part.u, part.y) * part.N for part in data.experiments) < 0.0
    if isinstance(motor, ServoMotor) or chain.block("sensor") or travel_of(chain) or not (free and falls and way > 0.0):
        return chain
    turned = replace(motor, at=0.5, period=motor.period / way)
    scale = {"map.low": float(y.max()), "map.high": float(y.min())}
    blocks = (*chain.blocks[:k], turned, TravelMap(2, role="map"), *chain.blocks[k + 1 :])
    return replace(chain, blocks=blocks, fixed={**chain.fixed, **scale})


def present_ends(fit: Fit) -> tuple[str, Fit]:
    """The end stops that the fitted joint has, without a choice, and the joint."""
    if motor_of(fit.model).stops:
        return "both", fit
    return "none" if travel_of(fit.model) else "straight", fit


def choose_ends(
    both: Fit, data: IOData, cut: IOData, pair: tuple[Fold, ...], options: dict[str, Any], turns: bool = True
) -> tuple[str, Fit]:
    """The end stops with least BIC and the joint with these; each stop costs `MARGIN` besides, and must do no harm.

    The joints are fitted to `cut`, the record in stretches, and harm is judged on `pair`, its folds. Joints that are
    nearly as good as each other are judged with all their parts: the free run of a joint without friction that falls
    with speed, or without a load that repeats every turn (`turns` allows it), may be so far off that its stops explain
    little.
    """
    chain = both.model
    if not motor_of(chain).stops:
        return present_ends(both)
    low, high = _end_outputs(both)
    travel = travel_of(chain)
    curved = travel is not None and not travel.is_line
    fits = {"both": both}
    for choice in ENDS:
        if choice == "both" or (choice == "straight" and not curved):
            continue
        variant_fit = _fit_variant(variant(chain, choice, low, high), both, data, cut, _OWN_STARTS, options)
        if variant_fit is not None:
            fits[choice] = variant_fit
    stopless = [name for name in fits if not ENDS[name]]
    if not stopless:
        return "both", both
    if min(fits[name].criteria.bic for name in stopless) < both.criteria.bic + _DOUBT * MARGIN:
        for name in stopless:
            variant_fit = _fit_variant(
                fits[name].model, fits[name], data, cut, 3 * _OWN_STARTS, {**options, "seed": options["seed"] + 1}
            )
            fits[name] = min((fits[name], variant_fit or fits[name]), key=lambda fit: fit.criteria.bic)
    if turns and "straight" in fits:
        fits["straight"] = with_turns(fits["straight"], data, cut, _SCREENING, options)
    cost = {name: MARGIN * (ENDS[name] + (name != "straight")) for name in fits}
    price = {name: fit.criteria.bic + cost[name] for name, fit in fits.items()}
    close = [n for n in fits if price[n] < min(price.values()) + max(_DOUBT * MARGIN, _NEARLY_AS_GOOD * data.N)]
    if len(close) > 1:
        for name in close:
            price[name] = min(price[name], _full_bic(fits[name], data, cut, options) + cost[name])
    choice = min(price, key=lambda name: price[name])
    free = min(stopless, key=lambda name: price[name])
    if ENDS[choice] and pair and price[free] < price[choice] + _CLEAR_MARGINS * MARGIN:
        errors = {name: holdout_errors(fits[name].model, fits[name].theta, pair) for name in (free, choice)}
        if is_harmful(errors[free], errors[choice], float(np.sqrt(both.criteria.mse))):
            choice = free
    return choice, fits[choice]


def _fit_variant(
    chain: Chain, known_fit: Fit, data: IOData, cut: IOData, own_starts: int, options: dict[str, Any]
) -> Fit | None:
    """From a known optimum, and from starts of its own where the stops are gone; None if every one of them diverges."""
    free = not motor_of(chain).stops
    points = (
        [lift_theta(known_fit.model, known_fit.theta, chain, {})]
        if travel_of(chain) or not travel_of(known_fit.model)
        else []
    )
    points += Joint().starts(chain, data, own_starts, options["seed"]) if free or not points else []
    try:
        return fit_chain(chain, cut, start=np.array(points), options=_SCREENING, **options)
    except (InputError, np.linalg.LinAlgError):
        return None


def _full_bic(plain: Fit, data: IOData, cut: IOData, options: dict[str, Any]) -> float:
    """BIC with all parts, near usual values; infinite where the joint runs away."""
    level = float(np.sqrt(plain.criteria.mse))
    try:
        return float(rough_posterior(plain, data, cut, level, _SCREENING, options).criteria.bic)
    except (InputError, np.linalg.LinAlgError):
        return np.inf


def _end_outputs(fit: Fit) -> tuple[float, float]:
    """Outputs at the lower and upper stop."""
    for b in fit.model.blocks:
        part = fit.model.part(fit.theta, b)
        if isinstance(b, Travel):
            return float(part[0]), float(part[1])
        if isinstance(b, Motor):
            outputs = b.value(part, "lower"), b.value(part, "upper")
    return outputs
