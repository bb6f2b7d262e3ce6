"""A fitted actuated joint as MJCF: the elements that give a MuJoCo model the joint's motor, friction, ends and play.

A record of volts and angles shows no torque: forces follow from one number that it does not hold, the torque per volt
of the standing motor (K / R of a data sheet, with the gear). With it, lag v' + v = gain (u - L - F) becomes the
equation of a motor with Ke = 1 / gain, R = Ke / torque per volt and armature = lag torque per volt / gain.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.blocks import CoastingPlay, Motor, Play, Quantiser, ServoMotor, Travel
from sysid.blocks.motor import LOADS
from sysid.estimation.joint_parts import is_joint, motor_of
from sysid.estimation.result import Fit
from sysid.export.servo_loop import controller, missing_of_servo
from sysid.model.wiring import identifier
from sysid.motor_parts import TABLE

STEP = 0.001  # [s] of the simulation that the numbers are made for
# Without them a loaded joint creeps and a stop is soft: MuJoCo's defaults are made for contacts.
STIFF = {"solimpfriction": "0.9999 0.9999 0.001", "solreffriction": "0.002 1"}
STOP = {"limited": "true", "solimplimit": "0.999 0.9999 0.0001", "solreflimit": "0.004 1"}
COUPLE = {"solimp": "0.9999 0.9999 0.001", "solref": "0.002 1"}
# What a model's defaults could set otherwise.
PLAIN = {"frictionloss": "0", "damping": "0", "stiffness": "0", "armature": "0", "limited": "false", "margin": "0"}
PLAIN |= {"springdamper": "0 0", "actuatorfrclimited": "false", "actuatorgravcomp": "false"}
FREE = {"limited": "false", "stiffness": "0", "damping": "0"}
SHORTEST = 0.25  # of a step: a shorter lag is over within the step, and would leave no inertia
LIGHT = 1e-3  # of the motor's inertia: the link of the model that checks the fragment
DRAG = 0.05  # of the motor's friction: what holds a link that lies within its play
# LuGre's bristles: deflection at break-away as a share of the stroke, and damping ratio with the rotor. Of 1e-3 to 3e-5
# and 0 to 1 these come closest to the chain on four records of shoulder and shank (0.25 % of the stroke RMS).
BEND, RATIO = 1e-4, 0.1
FAR = 1e6  # from the one stop that is known: a stop that is never met
_LOAD_OFF = 0.05  # of the friction: a load that is off by less starts and holds the joint as the fit does
FLAT = 1e-4  # of the load: what the cubic term that gives it a zero adds at the end of the stroke


@dataclass(frozen=True)
class Fragment:
    """MJCF elements of one joint, in the unit of the fit's output, and what they could not hold.

    `rotor` is a body for the worldbody, empty if motor and joint share one coordinate; `joints` belong into the body of
    the link; `actuator`, `equality` and `tendon` into the sections of these names. `start` is the first position by
    joint, `reading` the joints whose sum is the fit's output, `left_out` a sentence for each part without an MJCF
    element.
    """

    joint: str
    rotor: str
    joints: tuple[str, ...]
    actuator: str
    equality: str
    tendon: str
    start: dict[str, float]
    reading: tuple[str, ...]
    inertia: float
    left_out: tuple[str, ...]

    def model(self) -> str:
        """A model of MJCF with the fragment and a light link, which loads as it is."""
        sections = [
            ("tendon", self.tendon),
            ("equality", self.equality),
            ("actuator", self.actuator),
        ]
        ball = max(LIGHT * self.inertia, 1e-9)
        link = [
            f'<body name="{self.joint}_link" gravcomp="1"><!-- your link: put the joints below into its body -->',
            *(f"  {line}" for line in self.joints),
            f'  <inertial pos="0 0 0" mass="1e-3" diaginertia="{ball:.6g} {ball:.6g} {ball:.6g}"/>',
            '  <geom type="capsule" fromto="0 0 0 0 0 -0.1" size="0.01" mass="0" contype="0" conaffinity="0"/>',
            "</body>",
        ]
        body = [*([self.rotor] if self.rotor else []), *link]
        sentences = [f"       {sentence}" for sentence in self.left_out] or ["       nothing"]
        lines = [
            f'<mujoco model="{self.joint}">',
            "  <!-- The joint as identified, in SI units. Not held by these elements:",
            *sentences,
            "  -->",
            '  <compiler angle="radian" autolimits="true"/>',
            f'  <option timestep="{STEP}" integrator="implicitfast" tolerance="1e-12"/>',
            "  <worldbody>",
            *(f"    {line}" for text in body for line in text.split("\n")),
            "  </worldbody>",
        ]
        for name, content in sections:
            if content:
                lines += [f"  <{name}>", *(f"    {line}" for line in content.split("\n")), f"  </{name}>"]
        return "\n".join([*lines, "</mujoco>"]) + "\n"


@checked(late=True)
def fragment(fit: Fit, joint: str = "joint", torque_per_volt: float = 1.0, link_inertia: float = 0.0) -> Fragment:
    """The MJCF elements of a fitted `actuated_joint`, as joint `joint` of a model.

    torque_per_volt [N m/V at the joint]: of the standing motor with its gear. link_inertia [kg m2]: of the model's own
    link about the joint, which the identified lag contains and the fragment then leaves out. Raises InputError for
    another structure, a name that is not an identifier, and numbers that are not positive or leave no inertia.
    """
    identifier(joint)
    if not is_joint(fit.model):
        raise InputError(
            f"a {fit.model.structure} has no motor; MJCF is made of an actuated_joint: "
            "qpal identify FILE --structure actuated_joint"
        )
    for name, value, least in (("torque_per_volt", torque_per_volt, 0.0), ("link_inertia", link_inertia, -1.0)):
        if not least < value < np.inf:
            raise InputError(f"{name} is {value}; give a positive number")
    parts = _Parts(fit)
    if not parts.speed > 0.0:
        raise InputError(
            "the fitted motor never moves: its speed per volt is 0; identify a record in which the joint moves, with "
            "more starts"
        )
    return (
        parts.with_map(joint, torque_per_volt, link_inertia)
        if parts.travel
        else parts.direct(joint, torque_per_volt, link_inertia)
    )


class _Parts:
    """The blocks of the joint and the numbers of its motor in seconds and units of its position."""

    def __init__(self, fit: Fit) -> None:
        chain, theta = fit.model, fit.theta
        self.motor: Motor = motor_of(chain)
        self.own = chain.part(theta, self.motor)
        self.travel = next((b for b in chain.blocks if isinstance(b, Travel)), None)
        self.play = next((b for b in chain.blocks if isinstance(b, Play | CoastingPlay)), None)
        self.width = float(chain.part(theta, self.play)[0]) if self.play is not None else 0.0
        self.within = self.width * float(chain.part(theta, self.play)[1]) if self.play is not None else 0.0
        self.map_theta = chain.part(theta, self.travel) if self.travel is not None else None
        self.Ts = Ts = fit.Ts
        value = {name: self.motor.value(self.own, name) for name in self.names}
        self.speed = value["gain"] / Ts  # of the position, per volt
        self.lag, self.delay = value["lag"] * Ts, value["delay"] * Ts
        self.friction = 0.5 * (value["rise"] + value["fall"])
        self.lower, self.upper = (value["lower"], value["upper"]) if self.motor.stops else (-np.inf, np.inf)
        stroke = self.upper - self.lower
        self.stroke = stroke if np.isfinite(stroke) else 1.0  # a map's motor goes from 0 to 1
        tilt = 0.5 * (value["rise"] - value["fall"])  # friction that differs by direction acts as a constant load
        self.load = np.array([value["load0"] + tilt, *(value[name] for name in LOADS[1:])])
        self.tilt = tilt
        self.stick, self.stick_speed = value["stick"], value["stick_speed"] / Ts
        if self.motor.sided:
            self.stick = 0.5 * (self.stick + value["stick_down"])
        self.first = value["x0"]
        self.left_out = self._missing(chain, value)

    names = (
        *("gain", "lag", "delay", "rise", "fall", *LOADS, "stick", "stick_down", "stick_speed"),
        *("lower", "upper", "x0", "loss", "jam", "bearing"),
    )

    def _missing(self, chain, value: dict[str, float]) -> tuple[str, ...]:
        sentences = []
        if value["loss"] > 0.0:
            low = self.lower if np.isfinite(self.lower) else min(self.first, self.upper) - self.stroke
            ends = (low, self.upper if np.isfinite(self.upper) else max(self.first, low) + self.stroke)
            x = np.linspace(*ends, 101)
            share = value["loss"] * float(np.mean(np.abs(self._load_at(x))))
            self.friction += share
            sentences.append(
                f"friction of {value['loss']:.3g} times the load: its mean over the stroke is in frictionloss"
            )
        if value["bearing"] > 0.0:
            x = np.linspace(self.lower, self.upper, 101)
            self.friction += float(np.mean([self.motor.borne(self.own, place)[1] for place in x.tolist()]))
            sentences.append("a bearing's friction by the slope of the linkage: its mean is in frictionloss")
        if value["jam"] > 0.0:
            sentences.append("jamming at a struck end stop")
        if self.motor.sided:
            sentences.append("friction at rest that differs by direction: its mean is in lugre")
        sentences += [TABLE[part].words for part in self.motor.further]
        sentences += missing_of_servo(self.motor, self.own) if isinstance(self.motor, ServoMotor) else []
        if self.motor.periodic:
            sentences.append("the periodic load over the angle: your link's weight takes its place")
        if len(self.motor.ends) == 1:
            missing_side = "upper" if self.motor.ends == ("lower",) else "lower"
            sentences.append(
                f"the {missing_side} end stop, which the fit does not know: give the joint a range of your own"
            )
        if isinstance(self.play, CoastingPlay):
            sentences.append(
                "the flight of the link within its backlash: the inertia and weight of your link take its place"
            )
        exportable = (Motor, Travel, Play, CoastingPlay)
        for block in chain.blocks:
            if isinstance(block, Quantiser):
                sentences.append("levels of the driver: round the command before it reaches ctrl")
            elif not isinstance(block, exportable):
                sentences.append(
                    f"the {block.role} ({type(block).__name__}): apply it to ctrl or to the reading yourself"
                )
        return tuple(sentences)

    def _load_at(self, x: np.ndarray) -> np.ndarray:
        return self.tilt + np.array([self.motor.borne(self.own, place)[0] for place in x.tolist()])

    def direct(self, joint: str, per_volt: float, link_inertia: float) -> Fragment:
        """Motor and joint share one coordinate."""
        inertia = self._inertia(per_volt, link_inertia)
        hinge = _joint(joint, "hinge", "0 1 0", **self._attributes(per_volt))
        motor = f'{self._motor(joint, joint, per_volt, inertia)} armature="{inertia:.9g}"'
        return self._fragment(joint, "", hinge, motor, "", {joint: self.first}, inertia, per_volt)

    def with_map(self, joint: str, torque_per_volt: float, link_inertia: float) -> Fragment:
        """The motor's position x in strokes is a slide, and the joint's angle a quartic in it."""
        quartic = self._quartic()
        # MuJoCo couples changes from the initial pose: the motor stands where the joint's angle is 0, or nearest to it.
        rest = _nearest(quartic)
        coefficients_at_rest = quartic(np.polynomial.Polynomial([rest, 1.0])).coef
        ratio = float(quartic.deriv()(0.5))
        per_volt = torque_per_volt * abs(ratio)  # the same power at mid stroke
        inertia = self._inertia(per_volt, link_inertia * ratio**2)
        name, at_joint = f"{joint}_motor", inertia / ratio**2
        rotor = "\n".join(
            [
                f'<body name="{name}" gravcomp="1"><!-- the motor: its position from 0 to 1 is the stroke -->',
                "  " + _joint(name, "slide", "1 0 0", ref=f"{rest:.9g}", **self._attributes(per_volt)),
                f'  <inertial pos="0 0 0" mass="{inertia:.9g}" diaginertia="{" ".join([f"{inertia:.3g}"] * 3)}"/>',
                "</body>",
            ]
        )
        coefficients = " ".join(f"{c:.9g}" for c in coefficients_at_rest)
        equality = f'<joint joint1="{joint}" joint2="{name}" polycoef="{coefficients}" active="true" {_text(COUPLE)}/>'
        hinge = _joint(joint, "hinge", "0 1 0", armature=f"{1e-4 * at_joint:.3g}")
        start = {joint: float(quartic(self.first)), name: self.first}
        motor = self._motor(joint, name, per_volt, inertia)
        return self._fragment(joint, rotor, hinge, motor, equality, start, at_joint, torque_per_volt)

    def _quartic(self) -> np.polynomial.Polynomial:
        """The linkage as MuJoCo can couple two joints, by least squares."""
        assert self.travel is not None
        assert self.map_theta is not None
        nodes = 0.5 - 0.5 * np.cos(np.pi * (np.arange(64) + 0.5) / 64)
        angles = self.travel.output(self.map_theta, nodes)
        quartic = np.polynomial.Polynomial.fit(nodes, angles, 4, domain=[0, 1]).convert()
        deviation = float(np.abs(quartic(nodes) - angles).max() / np.ptp(angles))
        if deviation > 1e-3:
            self.left_out += (f"the linkage beyond a quartic: {100 * deviation:.2f} % of the stroke at most",)
        return quartic

    def _cubic_load(self) -> np.ndarray:
        """Coefficients (4,) of the load as MuJoCo's stiffness can have it, by least squares over the stroke."""
        if not self.motor.lever:
            return self.load
        x = np.linspace(self.lower, self.upper, 401)
        powers = np.vander(x - self.motor.at, 4, increasing=True)
        known = self._load_at(x)
        load = np.linalg.lstsq(powers, known, rcond=None)[0]
        off = float(np.abs(powers @ load - known).max())
        if off > _LOAD_OFF * self.friction:
            self.left_out += (
                f"the load beyond a cubic: {off:.2g} V at most, beside a friction of {self.friction:.2g} V",
            )
        return np.asarray(load)

    def _motor(self, joint: str, driven: str, per_volt: float, inertia: float) -> str:
        constant = 1.0 / self.speed
        text = f'name="{joint}" joint="{driven}" motorconst="{constant:.9g} {constant:.9g}" '
        text += f'resistance="{constant / per_volt:.9g}" gear="1" ctrllimited="false" saturation="0 0 0" damping="0"'
        if self.stick > 0.0:
            text += f' lugre="{self._bristles(per_volt, inertia)}"'
        if isinstance(self.motor, ServoMotor):
            text += f" {controller(self.motor, self.own, self.Ts, per_volt, self.speed)}"
        steps = round(self.delay / STEP)
        return text + (f' delay="{steps * STEP:.3f}" nsample="{steps}"' if steps else "")

    def _fragment(
        self,
        joint: str,
        rotor: str,
        hinge: str,
        motor: str,
        equality: str,
        start: dict[str, float],
        inertia: float,
        torque_per_volt: float,
    ) -> Fragment:
        joints, tendon = [hinge], ""
        reading: tuple[str, ...] = (joint,)
        if self.width > 0.0:
            half, play = 0.5 * self.width, f"{joint}_play"
            reading = (joint, play)
            start = {**start, play: self.within}
            joints.append(_joint(play, "hinge", "0 1 0", range=f"{-half:.9g} {half:.9g}", **STOP))
            hold = DRAG * self.friction * torque_per_volt
            tendon = f'<fixed name="{joint}_angle" frictionloss="{hold:.6g}" {_text(FREE | STIFF)}>'
            tendon += "".join(f'<joint joint="{name}" coef="1"/>' for name in reading) + "</fixed>"
        return Fragment(
            joint, rotor, tuple(joints), f"<dcmotor {motor}/>", equality, tendon, start, reading, inertia, self.left_out
        )

    def _inertia(self, per_volt: float, link: float) -> float:
        """Inertia whose lag over a simulation step is exactly the identified one, without the link's."""
        braking = per_volt / self.speed
        lag = max(self.lag, SHORTEST * STEP)
        inertia = STEP * braking / np.expm1(STEP / lag) - link
        if inertia <= 0.0:
            raise InputError(
                f"the link's inertia is {link:.3g} and the identified lag holds {inertia + link:.3g} in all at this "
                "torque per volt; give a smaller link_inertia or a larger torque_per_volt"
            )
        return float(inertia)

    def _attributes(self, per_volt: float) -> dict[str, str]:
        """Friction, ends and load of the joint that the motor drives."""
        attributes: dict[str, str] = {}
        if self.stick == 0.0:  # else LuGre has all of it
            attributes |= {"frictionloss": f"{self._of_drive() * per_volt:.9g}", **STIFF}
        if self.motor.ends:  # a side without a stop gets one that it never meets
            low = self.lower if np.isfinite(self.lower) else self.upper - FAR
            high = self.upper if np.isfinite(self.upper) else self.lower + FAR
            attributes |= {"range": f"{low:.9g} {high:.9g}", **STOP}
        if np.any(self.load):
            attributes |= self._spring(per_volt)
        return attributes

    def _of_drive(self) -> float:
        """Friction of the motor [V]; with a play, a small share of it is the link's and acts behind the play."""
        return self.friction * (1.0 - DRAG if self.width > 0.0 else 1.0)

    def _bristles(self, per_volt: float, inertia: float) -> str:
        moving, at_rest = self._of_drive() * per_volt, (self._of_drive() + self.stick) * per_volt
        stiffness = max(moving, at_rest) / (BEND * self.stroke)
        damping = 2.0 * RATIO * np.sqrt(stiffness * inertia)
        return f"{stiffness:.6g} {damping:.6g} {moving:.9g} {at_rest:.9g} {self.stick_speed:.9g}"

    def _spring(self, per_volt: float) -> dict[str, str]:
        """The load over position, as a polynomial spring about one of its zeros.

        A load without a zero gets a cubic term so small that it adds nothing within the stroke, and so a zero far away.
        """
        force = np.polynomial.Polynomial([*(self._cubic_load() * per_volt), 0.0])
        roots = _real(force)
        if not len(roots):
            size = float(np.abs(force.coef).max())
            force = force + np.polynomial.Polynomial([0, 0, 0, FLAT * size / self.stroke**3])
            roots = _real(force)
        root = roots[np.abs(roots).argmin()]
        shifted_force = force(np.polynomial.Polynomial([root, 1.0])).coef
        terms = " ".join(f"{c:.15g}" for c in [*shifted_force[1:], 0.0, 0.0, 0.0][:3])
        return {"stiffness": terms, "springref": f"{root + self.motor.at:.15g}"}


def _nearest(quartic: np.polynomial.Polynomial) -> float:
    """Where from 0 to 1 the quartic comes nearest to 0."""
    places = np.clip([0.0, 1.0, *_real(quartic)], 0.0, 1.0)
    return float(places[np.abs(quartic(places)).argmin()])


def _real(polynomial: np.polynomial.Polynomial) -> np.ndarray:
    roots = polynomial.trim().roots()
    return roots[np.abs(roots.imag) < 1e-12 * np.maximum(np.abs(roots), 1.0)].real


def _joint(name: str, kind: str, axis: str, **attributes: str) -> str:
    return f'<joint name="{name}" type="{kind}" axis="{axis}" {_text(PLAIN | attributes)}/>'


def _text(attributes: Mapping[str, str]) -> str:
    return " ".join(f'{name}="{value}"' for name, value in attributes.items())
