"""An actuated joint with as much physics as the record supports: parts are added one by one while BIC falls."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.block.block import Block
from sysid.blocks import CoastingPlay, Motor, Play
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.joint_parts import FRICTIONS, friction_starts, lifted, motor_of, shaken, sub
from sysid.estimation.play_start import play_starts
from sysid.estimation.result import Fit
from sysid.model.chain import Chain
from sysid.structures import actuated_joint

# Three times what counts as very strong evidence (Kass and Raftery, J. Amer. Statist. Assoc. 90, 1995, section 3.2):
# residuals of a model that is not quite the joint are coloured, and BIC takes them as white.
MARGIN = 30.0
PLAYS, COASTS = "plays", "coasts"
# A self-locking screw has load-dependent friction and jams; one of the two alone may not lower BIC.
PARTS: dict[str, tuple[str, ...]] = {name: (name,) for name in FRICTIONS}
PARTS |= {"screw": ("loss", "jams"), PLAYS: (), COASTS: ()}
WORDS = {
    "stribeck": "friction that falls with speed",
    "loss": "screw friction proportional to its load",
    "jams": "jamming at struck stops",
    "screw": "screw friction proportional to its load, and jamming at the end stops",
    PLAYS: "a play",
    COASTS: "backlash with a coasting link",
}
_TRIED = 3  # of the plays that promise most, how many are tried
_SHAKES = 12  # places near an optimum that are tried
_SUBSTEPS = 4  # of a sample, for a curve of friction that changes within it


@dataclass(frozen=True)
class Step:
    """One part tried in a round: BIC with it, its reduction of BIC, and whether the part was kept."""

    round: int
    part: str
    bic: float
    earned: float
    kept: bool


@dataclass(frozen=True)
class Growth:
    """The resulting joint, BIC of the plain joint, and the parts tried, in order."""

    fit: Fit
    plain_bic: float
    steps: tuple[Step, ...]

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts that were kept."""
        return tuple(step.part for step in self.steps if step.kept)

    def sentence(self) -> str:
        """The parts kept, in words."""
        if not self.parts:
            return "No part other than dry friction and a position-dependent load improves BIC enough on this record."
        kept = [f"{WORDS[step.part]} ({step.bic:.0f})" for step in self.steps if step.kept]
        return f"Kept beside dry friction and a position-dependent load (BIC {self.plain_bic:.0f}): {', '.join(kept)}."

    def as_dict(self) -> dict[str, Any]:
        """The steps, ready for JSON."""
        return {"plain_bic": self.plain_bic, "parts": list(self.parts), "steps": [vars(step) for step in self.steps]}


def grow_joint(
    data: IOData,
    plain: Chain | None = None,
    search: str = "lm",
    starts: int = 4,
    seed: int = 0,
    parts: Iterable[str] = tuple(PARTS),
    progress: Callable[[str], None] | None = None,
) -> Growth:
    """Fit an actuated joint to `data` and repeatedly add the part that lowers BIC most, as long as one does.

    Parts: "stribeck" (friction that falls with speed), "loss" (screw friction proportional to the load), "jams" (the
    motor jams at an end stop), "screw" (both), "plays" (backlash), "coasts" (backlash whose link has inertia and
    weight). Each part starts from the current fit and must lower BIC by `MARGIN`. `plain` is the initial joint, an
    `actuated_joint` with a motor and without those parts or backlash; search, starts, seed and progress are those of
    `sysid.fit`. Raises InputError for an unsuitable part or plain joint, and the errors of `sysid.fit`.
    """
    parts = tuple(parts)
    for part in parts:
        if part not in PARTS:
            raise unknown("part of a joint", part, PARTS)
    chain = actuated_joint(play=False) if plain is None else plain
    if not _is_plain(chain):
        raise InputError("grow_joint begins with a plain actuated_joint; leave Stribeck, loss, jam and play out")
    options: dict[str, Any] = {"search": search, "seed": seed, "progress": progress}
    fit = _shaken(fit_chain(chain, data, starts=starts, **options), data, options)
    first, steps = float(fit.criteria.bic), []
    for k in count():
        tried = {
            name: fit_chain(richer, data, start=points, **options) for name, richer, points in _more(fit, data, parts)
        }
        if not tried:
            break
        best = min(tried, key=lambda name: tried[name].criteria.bic)
        earned = {name: float(fit.criteria.bic - other.criteria.bic) for name, other in tried.items()}
        kept = earned[best] > MARGIN
        steps += [
            Step(k, name, float(other.criteria.bic), earned[name], kept and name == best)
            for name, other in tried.items()
        ]
        if not kept:
            break
        fit = _shaken(tried[best], data, options)  # from beside its optimum the next part would make up for that
    growth = Growth(fit, first, tuple(steps))
    return replace(growth, fit=_shaken(fit, data, options, growth.parts)) if growth.parts else growth


def _shaken(fit: Fit, data: IOData, options: dict[str, Any], grown: tuple[str, ...] = ()) -> Fit:
    """The fit, or a better one from nearby starts: whether a stop is reached in time is discrete and blocks the search.

    The first of several `grown` parts is started again from its initial values, because it was added to a simpler
    joint.
    """
    chain, rng = fit.model, np.random.default_rng([options["seed"], len(fit.theta)])
    points = [np.clip(shaken(chain, fit.theta, rng), *chain.limits) for _ in range(_SHAKES)]
    if len(grown) > 1 and PARTS[grown[0]]:
        again = friction_starts(PARTS[grown[0]], chain, fit.theta, data)
        points += [lifted(chain, fit.theta, chain, more) for more in again]
    other = fit_chain(chain, data, start=np.array(points), **options)
    return other if other.criteria.loss < fit.criteria.loss else fit


def _more(fit: Fit, data: IOData, parts: Iterable[str]) -> Iterator[tuple[str, Chain, np.ndarray]]:
    """Every chain with one more part than the fit, with starting points (K, P)."""
    chain, theta = fit.model, fit.theta
    motor = motor_of(chain)
    for name in parts:
        if name in (PLAYS, COASTS):
            # A link that coasts may take the place of a play.
            held = CoastingPlay if name == COASTS else Play | CoastingPlay
            if any(isinstance(b, held) for b in chain.blocks):
                continue
            bare = sub(chain, tuple(b for b in chain.blocks if not isinstance(b, Play)))
            richer = _with_play(bare, CoastingPlay(role="play") if name == COASTS else Play(role="play"))
            found = play_starts(richer, bare, lifted(chain, theta, bare, {}), data)[:_TRIED]
        else:
            options = PARTS[name]
            if any(getattr(motor, option) or not _possible(motor, option) for option in options):
                continue
            richer = _with_options(chain, motor, options)
            found = friction_starts(options, chain, theta, data)
        yield name, richer, np.array([lifted(chain, theta, richer, more) for more in found])


def _is_plain(chain: Chain) -> bool:
    """Whether the chain has a motor and none of the parts that can be added."""
    motors = [b for b in chain.blocks if isinstance(b, Motor)]
    richer = any(getattr(b, option) for b in motors for option in FRICTIONS)
    return bool(motors) and not richer and not any(isinstance(b, Play | CoastingPlay) for b in chain.blocks)


def _possible(motor: Motor, option: str) -> bool:
    return {"loss": motor.load > 0, "jams": motor.stops}.get(option, True)


def _with_play(chain: Chain, play: Block) -> Chain:
    """The chain with backlash, placed before the sensor if there is one."""
    place = len(chain.blocks) - (chain.blocks[-1].role == "sensor")
    return sub(chain, (*chain.blocks[:place], play, *chain.blocks[place:]))


def _with_options(chain: Chain, motor: Motor, options: tuple[str, ...]) -> Chain:
    richer = replace(
        motor,
        stribeck=motor.stribeck or "stribeck" in options,
        loss=motor.loss or "loss" in options,
        jams=motor.jams or "jams" in options,
        substeps=max(motor.substeps, _SUBSTEPS if "stribeck" in options else 1),
    )
    held = dict(chain.fixed)
    if "loss" in options and held.get(f"{motor.role}.load0") == 0.0:
        del held[f"{motor.role}.load0"]  # a loss tells a load from a difference between the frictions
    return sub(replace(chain, fixed=held), tuple(richer if b is motor else b for b in chain.blocks))
