"""Parts of a grown joint that it does without: a later part may do what an earlier one made up for."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Block
from sysid.blocks import CoastingPlay, Play
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.joint_parts import lift_theta, motor_of, sub
from sysid.estimation.result import Fit
from sysid.joint.parts import PARTS
from sysid.model.chain import Chain
from sysid.solver.iterate import Options

_SCREENING = Options(max_iterations=20)
Candidate = tuple[Chain, np.ndarray]


def remaining(kept: tuple[str, ...], dropped: tuple[str, ...]) -> tuple[str, ...]:
    """The parts kept without those dropped; of a part that is made of two the other one stays."""
    found = []
    for name in kept:
        own = PARTS[name].options
        if name in dropped or (own and set(own) <= set(dropped)):
            continue
        left = [option for option in own if option not in dropped]
        found += [name] if len(left) == len(own) else left
    return tuple(found)


def pruned(
    fit: Fit, data: IOData, kept: tuple[str, ...], margin: float, options: dict[str, Any]
) -> tuple[Fit, tuple[str, ...]]:
    """The fit without every part whose loss raises BIC by `margin` or less, and the names of these parts.

    Nearly nothing of a joint's error in free run may depend on a part, and yet its value decides the next record: a
    jam at a stop that no turn of this record falls into, for example.
    """
    dropped: tuple[str, ...] = ()
    while True:
        fewer = {}
        for name in remaining(kept, dropped):
            for single, (chain, points) in without(name, fit):
                try:
                    fewer[single] = fit_chain(chain, data, start=points, options=_SCREENING, **options)
                except (InputError, np.linalg.LinAlgError):
                    continue
        best = min(fewer, key=lambda name: fewer[name].criteria.bic, default=None)
        if best is None or fewer[best].criteria.bic > fit.criteria.bic + margin:
            return fit, dropped
        fit, dropped = fewer[best], (*dropped, best)


def without(name: str, fit: Fit) -> Iterator[tuple[str, Candidate]]:
    """The chain without a part and starting points (K, P), or one of each where the part is made of two."""
    part, chain, motor = PARTS[name], fit.model, motor_of(fit.model)
    if part.play is not None:
        yield name, _from(fit, tuple(b for b in chain.blocks if not isinstance(b, Play | CoastingPlay)), [{}])
    for option in part.options:
        if option == "stribeck" and motor.sided:  # which goes first
            continue
        switched: dict[str, Any] = {option: False} | ({"substeps": 1} if option == "stribeck" else {})
        plainer = replace(motor, **switched)
        blocks = tuple(plainer if b is motor else b for b in chain.blocks)
        yield option, _from(fit, blocks, _instead(option, fit))


def _from(fit: Fit, blocks: tuple[Block, ...], points: list[dict[str, float]]) -> Candidate:
    plainer = sub(fit.model, blocks)
    return plainer, np.array([lift_theta(fit.model, fit.theta, plainer, point) for point in points])


def _instead(option: str, fit: Fit) -> list[dict[str, float]]:
    """What the other parameters may be without this one: the friction at mid stroke stays."""
    motor = motor_of(fit.model)
    p = {**motor.absent, **motor.by_name(fit.model.part(fit.theta, motor))}
    if option == "loss":
        lost, load = p["loss"] * abs(p["load0"]), p["load0"]
        dry = {"rise": p["rise"] + lost + load, "fall": p["fall"] + lost - load, "load0": 0.0}
        return [{f"{motor.role}.{name}": value for name, value in dry.items()}]
    if option == "sided":
        return [
            {f"{motor.role}.stick": p["stick"] + share * (p["stick_down"] - p["stick"])} for share in (0.2, 0.5, 0.8)
        ]
    if option == "stribeck":
        shares = (0.0, 0.3)
        return [{f"{motor.role}.{way}": p[way] + share * p["stick"] for way in ("rise", "fall")} for share in shares]
    return [{}]
