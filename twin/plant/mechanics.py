"""The bench of one joint as numbers for `twin.plant.reduced`, and its course without MuJoCo's general machinery."""

from collections.abc import Collection
from dataclasses import dataclass, field
from functools import lru_cache

import mujoco
import numpy as np

from twin.hardware.linkage import linkage, stroke
from twin.parameters import Parameters
from twin.plant import reduced as r
from twin.plant import slots
from twin.plant.added import NOTHING, RUB, Added
from twin.plant.board import circuit, user_data
from twin.plant.leg import BENCH_LEG, LEAST, bench_spec

# Rows of the driven joint that do not change the masses, their places, or what the foot can reach.
_OF_DRIVE = (
    *("rated_voltage", "no_load_speed", "stall_force", "stall_torque", "gear_ratio", "lead", "rotor_inertia"),
    *("coulomb", "asymmetry", "stribeck", "stribeck_speed", "load_friction", "viscous"),
    *("bearing_coulomb", "bearing_viscous", "backlash", "lower", "upper", "retracted_length", "stroke"),
)
_OF_BOARD = ("supply_voltage", "supply_resistance", "dead_band", "delay")
CLEAR = 0.1  # [rad] that a course keeps from angles at which the foot touches something
_TURN = np.arange(0.0, 2.0 * np.pi, 0.01)


@dataclass(frozen=True)
class Body:
    """The links of a bench: `model`, whose drive is that of some parameters; mechanics (SIZE,) without the drive;
    constraints (3, 7); and the angles [rad] of one turn at which something touches the links."""

    model: mujoco.MjModel
    mechanics: np.ndarray
    soft: np.ndarray
    contacts: np.ndarray

    def free(self, low: float, start: float, high: float) -> bool:
        """Whether nothing touches the links from `low` over `start` to `high` [rad], nor somewhat beyond."""
        above, below = ((sign * (self.contacts - start)) % (2.0 * np.pi) for sign in (1.0, -1.0))
        return bool(
            high - start + CLEAR < above.min(initial=np.inf) and start - low + CLEAR < below.min(initial=np.inf)
        )


def course(
    p: Parameters,
    joint: str,
    without: Collection[str],
    commands: np.ndarray,
    start: float,
    settle: float,
    servo: bool = False,
    pot_on_link: bool = True,
    seed: int = 0,
    added: Added = NOTHING,
) -> np.ndarray | None:
    """Readings (steps,) [rad] before each simulation step of the bench of `joint` under commands (steps,) [V].

    The drive starts at `start` [rad], `settle` [s] before the first command. `added` is what
    the drive has beside its parameters. NaN where the simulation fails. None where
    a link would touch the floor or the torso: MuJoCo's contacts are not here. See `twin.experiment` for the others.
    """
    electric = circuit(p, joint, without)
    values, body = p.switched_off(without), _body(_bench(p, joint, tuple(without)))
    board = user_data(body.model, [electric], servo, pot_on_link, seed)
    c, h, pot = body.mechanics.copy(), board[slots.STEP], electric.pot
    c[r.LOW], c[r.HIGH] = stroke(p, joint)
    c[r.LIMITED], c[r.PLAY] = "end_stops" not in without, values[f"{joint}.backlash"] / 2.0
    loaded = "load_friction" not in without and "friction" not in without
    c[r.RUBS] = max(values[f"{joint}.coulomb"], LEAST if loaded else 0.0) > 0.0
    c[r.VISCOUS], c[r.BEARING_VISCOUS] = values[f"{joint}.viscous"], values[f"{joint}.bearing_viscous"]
    c[r.BEARING] = values[f"{joint}.bearing_coulomb"]
    out = np.empty(len(commands))
    hold, delay = (pot.scale * start if servo else 0.0), round(values["delay"] / h)
    c[r.RUBS] = c[r.RUBS] or bool(added.table[RUB].any())
    lead = round(settle / h)
    assert r.roll(board, c, body.soft, start, commands, delay, hold, lead, out, added.table, added.spans)
    if not np.isfinite(out).all():
        return np.full(len(out), np.nan)
    return out if body.free(float(out.min()), start, float(out.max())) else None


@dataclass(frozen=True)
class _Bench:
    """A bench whose `parameters` differ from those of an equal one only in what the drive has; `rows` are the rest."""

    joint: str
    without: tuple[str, ...]
    rows: tuple[tuple[str, float], ...]
    parameters: Parameters = field(compare=False)


def _bench(p: Parameters, joint: str, without: tuple[str, ...]) -> _Bench:
    drive = {f"{joint}.{name}" for name in _OF_DRIVE} | set(_OF_BOARD)
    return _Bench(joint, without, tuple(item for item in p.values.items() if item[0] not in drive), p)


@lru_cache(maxsize=256)
def _body(key: _Bench) -> Body:
    """The body of a model that is compiled for it, by MuJoCo's mass matrix and weights at two angles."""
    joint, p = key.joint, key.parameters
    spec = bench_spec(joint, p, key.without)
    spec.actuator(joint + BENCH_LEG).armature = 0.0  # the rotor is of the drive
    model, c = spec.compile(), np.zeros(r.SIZE)
    data, full, plays = mujoco.MjData(model), np.zeros((model.nv, model.nv)), model.nv > 1
    weights = []
    for angle in (np.pi / 2, 0.0):
        data.qpos[:] = 0.0
        data.qpos[0] = angle
        mujoco.mj_forward(model, data)
        weights.append(data.qfrc_bias.copy())
    mujoco.mj_fullM(model, data, full)
    c[r.PLAYS], on_link = plays, model.nv - 1  # the play is the second hinge; without it all moves with the link
    c[r.LINK] = full[on_link, on_link]
    c[r.LEVER] = full[0, 0] - c[r.LINK]
    c[r.LINK_SIN], c[r.LINK_COS] = (weight[on_link] for weight in weights)
    c[r.LEVER_SIN], c[r.LEVER_COS] = (weight[0] - weight[on_link] for weight in weights)
    if joint != "shoulder":
        triangle = linkage(p, joint)
        c[r.BASE], c[r.ROD], c[r.ENCLOSED] = triangle.base, triangle.rod, triangle.offset
    return Body(model, c, _constraints(model, joint, plays), _contacts(model, data))


def _constraints(model: mujoco.MjModel, joint: str, plays: bool) -> np.ndarray:
    """MuJoCo's solref and solimp of dry friction, ends of stroke and play (3, 7)."""
    if joint == "shoulder":
        friction, end = (model.dof_solref[0], model.dof_solimp[0]), (model.jnt_solref[0], model.jnt_solimp[0])
    else:
        k = model.tendon(joint + BENCH_LEG).id
        friction = model.tendon_solref_fri[k], model.tendon_solimp_fri[k]
        end = model.tendon_solref_lim[k], model.tendon_solimp_lim[k]
    play = model.jnt_solref[int(plays)], model.jnt_solimp[int(plays)]
    return np.array([np.concatenate(pair) for pair in (friction, end, play)])


def _contacts(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """The angles [rad] of one turn at which MuJoCo finds a contact."""
    touches = []
    for angle in _TURN:
        data.qpos[:] = 0.0
        data.qpos[0] = angle
        mujoco.mj_fwdPosition(model, data)
        touches.append(data.ncon > 0)
    return _TURN[np.array(touches)]
