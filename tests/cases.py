"""One ready instance for each registered name; the contract tests run over these tables."""

import math
from pathlib import Path

import numpy as np

import sysid
from sysid.blocks import (
    STATIC,
    BowedGain,
    BoxJenkins,
    Channels,
    CoastingPlay,
    Compliance,
    CubicSpline,
    Custom,
    DeadZone,
    DeadZoneSaturation,
    Delay,
    FrictionLag,
    Innovations,
    LimitedIntegrator,
    Linkage,
    Motor,
    Offset,
    PiecewiseLinear,
    Play,
    Polynomial,
    Process,
    ProfiledMotor,
    Quantiser,
    Rectifier,
    Saturation,
    ServoMotor,
    SigmoidNetwork,
    StateSpace,
    TransferFunction,
    TransferMatrix,
    TravelMap,
    WaveletNetwork,
    Wrap,
    dynamic,
)
from sysid.excitations import Aprbs, Chirp, Multisine, Prbs, Staircase, Steps, Sweep
from sysid.structures import (
    ActuatedJoint,
    Armax,
    Arx,
    CoupledDrives,
    Hammerstein,
    HammersteinWiener,
    MotorProfile,
    NonlinearArx,
    NonlinearStateSpace,
    OutputError,
    ProcessModel,
    ServoJoint,
    Wiener,
    WienerHammerstein,
)
from sysid.structures import (
    BoxJenkins as BoxJenkinsRecipe,
)

# A lag with a rate limit, in the way a user writes one.
RATE_LIMITED = """
def begin(s, x, p):
    s.level = p.y0

def step(s, x, p):
    y = s.level
    s.level += min(max(p.speed * (p.gain * x - y), -p.fall), p.rise)
    return y
"""
# Block and parameters in the interior of its domain, for inputs in [-2, 2].
BLOCKS = {
    "bowed_gain": (BowedGain(role="map"), np.array([0.4])),
    "box_jenkins": (  # b, f, x0, c, d
        BoxJenkins(nb=2, nf=2, nk=1, nc=1, nd=2, role="map"),
        np.array([0.8, 0.5, -1.5, 0.6, 0.3, -0.4, 0.4, -0.9, 0.3]),
    ),
    "channels": (
        Channels(maps=(Saturation(), Polynomial(degree=2)), role="map"),
        np.array([-1.1, 1.3, 0.3, 1.1, 0.4]),
    ),
    "coasting_play": (CoastingPlay(role="map"), np.array([0.8, 0.2, 0.15, 0.05, 0.1])),
    "compliance": (Compliance(role="map"), np.array([0.9, 0.2, 0.1, -0.05])),
    "cubic_spline": (
        CubicSpline(knots=5, role="map"),
        np.array([-1.6, 1.7, -1.2, -0.4, 0.3, 0.1, 1.5]),
    ),
    "custom": (  # tanh with a gain, a bend and an offset; no derivatives given, so that differences are tested
        Custom(
            f=lambda x, theta: theta[0] * np.tanh(theta[1] * x) + theta[2],
            names=("gain", "bend", "offset"),
            initial=(1.0, 0.5, 0.0),
            role="map",
        ),
        np.array([1.3, 0.8, -0.2]),
    ),
    "dead_zone": (DeadZone(role="map"), np.array([-0.4, 0.7])),
    "dead_zone_saturation": (
        DeadZoneSaturation(role="map"),
        np.array([-0.9, -0.15, 0.2, 0.8, 3.0, 2.5]),
    ),
    "delay": (Delay(role="map"), np.array([1.37])),
    "dynamic": (
        dynamic(
            RATE_LIMITED,
            {"gain": 1.0, "speed": 0.5, "rise": 1.0, "fall": 1.0, "y0": 0.0},
            bounds={"speed": (0.0, 1.0), "rise": (0.0, 9.0), "fall": (0.0, 9.0)},
            initial=("y0",),
            role="map",
        ),
        np.array([1.4, 0.3, 0.25, 0.35, 0.2]),
    ),
    "friction_lag": (FrictionLag(role="map"), np.array([0.3, 0.1, 0.2, 0.6, 0.15])),
    "innovations": (  # b, f with a pole outside the unit circle, x0, c
        Innovations(nb=2, nf=2, nk=1, role="map"),
        np.array([0.8, 0.5, -1.65, 0.63, 0.3, -0.4, -0.9, 0.3]),
    ),
    "limited_integrator": (LimitedIntegrator(role="map"), np.array([0.3, -0.6, 0.5, 0.1])),
    "motor": (  # gain, lag, rise, fall, load0, delay, lower, upper, x0, v0
        Motor(role="map"),
        np.array([0.15, 0.6, 0.3, 0.4, -0.1, 0.37, 0.05, 1.1, 0.4, 0.1]),
    ),
    "piecewise_linear": (
        PiecewiseLinear(knots=5, role="map"),
        np.array([-1.7, -0.6, 0.1, 0.9, 1.6, -1.0, -0.9, 0.3, 0.4, 2.0]),
    ),
    "play": (Play(role="map"), np.array([0.8, 0.2])),
    "polynomial": (Polynomial(degree=3, role="map"), np.array([0.3, -0.2, 1.1, 0.4])),
    "process": (  # K, T1, T2, Td, x1, x2
        Process(lags=2, Ts=0.5, role="map"),
        np.array([1.3, 1.6, 0.7, 0.83, 0.4, -0.2]),
    ),
    "profiled_motor": (  # inertia, drag_up, drag_down, rise (3), fall (3), x0, v0
        ProfiledMotor(knots=3, low=-1.0, high=2.0, role="map"),
        np.array([3.0, 2.0, 2.4, 0.3, 0.5, 0.2, 0.4, 0.1, 0.35, 0.4, 0.1]),
    ),
    "quantiser": (Quantiser(step=0.3, role="map"), np.empty(0)),
    "offset": (Offset(role="map"), np.array([0.7])),
    "rectifier": (Rectifier(role="map"), np.array([-0.3])),
    "saturation": (Saturation(role="map"), np.array([-1.1, 1.3])),
    "servo_motor": (  # kp, limit, gain, lag, rise, fall, load0, delay, lower, upper, x0, v0
        ServoMotor(updates=3, role="map"),
        np.array([0.9, 1.1, 0.3, 2.6, 0.2, 0.25, -0.05, 0.37, -1.2, 1.1, 0.4, 0.1]),
    ),
    "sigmoid_network": (
        SigmoidNetwork(units=3, role="map"),
        np.array([0.2, 0.7, 1.0, -0.8, 0.5, 3.0, 2.0, -4.0, 1.0, -0.5, 0.7]),
    ),
    "state_space": (
        StateSpace(nx=2, units=2, degree=2, readout=True, u_scale=(1.7,), y_centre=(0.3,), y_scale=(-2.5,), role="map"),
        np.array(
            [
                *(0.7, 0.3, -0.25, 0.6, 0.5, -0.4, 0.8, 0.3, 0.2, 0.1),  # A, B, C, D, d
                *(0.3, -0.2, 0.03, -0.02, 0.04, 0.01, 0.02, -0.05, 0.1, 0.25, 0.02, 0.03, -0.03, 0.05, -0.01, 0.02),
                *(0.2, -0.3, 0.05, 0.04, -0.03, 0.02, 0.01, -0.04),  # after E: F
                *(0.6, -0.4, 0.3, 0.9, 0.7, -0.5, 0.4, -0.3, 0.2, -0.1),  # W, V, b, x0
            ]
        ),
    ),
    "transfer_function": (
        TransferFunction(nb=2, nf=3, nk=2, role="map"),
        np.array([0.8, 0.5, -1.7, 1.0, -0.21, 0.3, -0.4, 0.2]),
    ),
    "transfer_matrix": (
        TransferMatrix(
            entries=(
                (TransferFunction(1, 1, 1), TransferFunction(2, 1, 0)),
                (TransferFunction(1, 2, 1), TransferFunction(1, 1, 2)),
            ),
            role="map",
        ),
        np.array([0.8, -0.6, 0.2, 0.5, 0.3, -0.8, 0.1, 0.9, -1.2, 0.5, 0.2, -0.3, 0.4, 0.55, 0.1, -0.2]),
    ),
    "travel_map": (TravelMap(knots=5, role="map"), np.array([-0.8, 1.1, 0.3, 0.45, 0.8])),
    "linkage": (Linkage(role="map"), np.array([-0.8, 1.1, 0.5, 2.7, 0.6])),
    "wavelet_network": (
        WaveletNetwork(wavelets=2, scaling=1, role="map"),
        np.array([0.2, 0.9, 0.6, -0.8, 0.7, 1.3, 2.1, 0.9, -0.8, 0.6, 0.3]),
    ),
    "wrap": (Wrap(turn=1.5, low=-0.4, role="map"), np.empty(0)),
}
BLOCKS |= {  # a map without a line above stands beside its start
    name: (kind(role="map"), kind().vary(kind().start(np.linspace(-2.0, 2.0, 101)), np.random.default_rng(0)))
    for name, kind in STATIC.items()
    if name not in BLOCKS
}
# Further options of the same blocks; they meet the same contracts.
VARIANTS = {
    "cubic_spline_monotone": (
        CubicSpline(knots=4, monotone=True, role="map"),
        np.array([-1.6, 1.7, -1.2, 2.0, 0.3, 4.0, 1.5, 0.8]),
    ),
    "cubic_spline_monotone_span": (
        CubicSpline(knots=4, monotone=True, span=(-1.5, 1.5), role="map"),
        np.array([-1.2, 2.0, 0.3, 4.0, 1.5, 0.8]),
    ),
    "cubic_spline_span": (
        CubicSpline(knots=5, span=(-1.5, 1.8), role="map"),
        np.array([-1.2, -0.4, 0.3, 0.1, 1.5]),
    ),
    "piecewise_linear_fixed": (
        PiecewiseLinear(knots=5, free_knots=False, at=(-1.7, -0.6, 0.1, 0.9, 1.6), role="map"),
        np.array([-1.0, -0.9, 0.3, 0.4, 2.0]),
    ),
    "travel_map_smooth": (TravelMap(knots=5, smooth=True, role="map"), np.array([-0.8, 1.1, 0.3, 0.5, 0.8])),
}
# Options of blocks with a memory, which no start makes an identity.
MOVING = {
    "compliance_critical": (Compliance(role="map"), np.array([0.7, 1.0, 0.1, -0.05])),
    "compliance_creeps": (Compliance(role="map"), np.array([1.4, 3.0, 0.1, -0.05])),
    "profiled_motor_turns": (  # inertia, drag_up, drag_down, rise (3), fall (3), delay, x0, v0
        ProfiledMotor(knots=3, low=-1.0, high=2.0, delayed=True, period=3.0, midway=True, substeps=2, role="map"),
        np.array([3.0, 2.0, 2.4, 0.3, 0.5, 0.2, 0.4, 0.1, 0.35, 1.37, 0.4, 0.1]),
    ),
    "motor_plain": (Motor(load=0, delayed=False, stops=False, role="map"), np.array([0.15, 0.6, 0.3, 0.4, 0.4, 0.1])),
    "motor_jams": (  # the same, jam before delay
        Motor(jams=True, role="map"),
        np.array([0.4, 0.6, 0.3, 0.4, -0.1, 6.0, 0.37, 0.05, 1.1, 0.4, 0.1]),
    ),
    "motor_sided": (  # gain, lag, rise, fall, stick, stick_speed, stick_down, load0, delay, lower, upper, x0, v0
        Motor(stribeck=True, sided=True, substeps=3, role="map"),
        np.array([0.15, 0.6, 0.3, 0.4, 0.3, 0.1, 0.15, -0.1, 1.37, 0.05, 1.1, 0.4, 0.1]),
    ),
    "motor_windage": (  # gain, lag, rise, fall, load0, windage, delay, lower, upper, x0, v0
        Motor(further=("windage",), substeps=3, role="map"),
        np.array([0.15, 0.6, 0.3, 0.4, -0.1, 2.0, 1.37, 0.05, 1.1, 0.4, 0.1]),
    ),
    "motor_warming": (  # gain, lag, rise, fall, load0, warmth, warm_time, delay, lower, upper, x0, v0
        Motor(further=("warming",), substeps=3, role="map"),
        np.array([0.15, 0.6, 0.3, 0.4, -0.1, 0.2, 6.0, 1.37, 0.05, 1.1, 0.4, 0.1]),
    ),
    "process_alike": (  # K, T1, T2, T3, Td, x1, x2, x3, u0: time constants that are nearly one
        Process(lags=3, history=1, role="map"),
        np.array([1.3, 1.6, 1.63, 1.58, 1.37, 0.4, -0.2, 0.1, 0.3]),
    ),
    "process_integrates": (  # K, wn, zeta, Tz, x1, x2, x4
        Process(lags=0, pair=True, zero=True, integrator=True, delayed=False, role="map"),
        np.array([0.3, 0.9, 0.4, -0.6, 0.4, 0.1, -0.3]),
    ),
    "process_pair": (  # K, wn, zeta, Td, x1, x2, u0: a pair that is nearly critical
        Process(lags=0, pair=True, history=1, Ts=0.5, role="map"),
        np.array([1.3, 0.9, 1.0, 0.2, 0.4, 0.1, 0.3]),
    ),
    "servo_pd_loaded": (  # kp, kd, dead, limit, sag, gain, lag, rise, fall, stick, stick_speed, load0-1, delay, x0, v0
        ServoMotor(
            loop="pd", dead=True, sags=True, load=2, stribeck=True, substeps=4, updates=2, stops=False, role="map"
        ),
        np.array([1.4, 0.6, 0.1, 1.1, 0.3, 0.3, 2.6, 0.1, 0.15, 0.07, 0.1, -0.1, 0.1, 1.37, 0.4, 0.1]),
    ),
    "servo_pid_held": (  # kp, kd, ki, i0, limit, gain, lag, rise, fall, x0, v0
        ServoMotor(loop="pid", held=True, load=0, updates=2, stops=False, delayed=False, role="map"),
        np.array([1.4, 0.6, 0.08, 0.1, 1.1, 0.3, 2.6, 0.3, 0.35, 0.4, 0.1]),
    ),
    "motor_swings": (  # gain, lag, rise, fall, load0, sine1, cosine1, sine2, cosine2, delay, lower, x0, v0
        Motor(periodic=2, period=1.5, stops="lower", role="map"),
        np.array([0.15, 0.6, 0.3, 0.4, -0.1, 0.5, 0.2, -0.1, 0.3, 0.37, 0.05, 0.4, 0.1]),
    ),
    "travel_map_bent_ends": (
        TravelMap(knots=5, smooth=True, bent_ends=True, role="map"),
        np.array([-0.8, 1.1, 0.3, 0.5, 0.8]),
    ),
    "linkage_bent": (Linkage(bends=2, role="map"), np.array([-0.8, 1.1, 0.9, 2.0, -0.6, 0.01, -0.004])),
    "motor_lever": (  # gain to fall, load0-3, bearing, angle0, angle1, stroke, loss, delay, lower, upper, x0, v0
        Motor(load=4, lever=True, loss=True, substeps=2, role="map"),
        np.array([0.15, 0.6, 0.3, 0.4, -0.1, 0.2, 0.15, -0.1, 0.05, 0.7, 2.6, 0.5, 0.3, 0.37, 0.0, 1.0, 0.4, 0.1]),
    ),
    "motor_loaded": (  # gain, lag, rise, fall, stick, stick_speed, load0-2, loss, delay, lower, upper, x0, v0
        Motor(load=3, loss=True, stribeck=True, substeps=3, role="map"),
        np.array([0.15, 0.6, 0.3, 0.4, 0.3, 0.1, -0.1, 0.2, 0.15, 0.5, 1.37, 0.05, 1.1, 0.4, 0.1]),
    ),
}
EXCITATIONS = {
    "aprbs": Aprbs(amplitude=3.0, hold_min=0.4, hold_max=2.0),
    "chirp": Chirp(amplitude=3.0, period=50.0),
    "multisine": Multisine(amplitude=3.0, grid="random_odd"),
    "prbs": Prbs(amplitude=3.0),
    "staircase": Staircase(amplitude=3.0),
    "steps": Steps(amplitude=3.0),
    "sweep": Sweep(amplitude=3.0, half_period=2.0),
}


# A recipe of each structure, with orders and maps.
STRUCTURES = {
    "actuated_joint": ActuatedJoint(driver_step=0.1, sensor_linearity=0.01, load="spring", stops="lower"),
    "armax": Armax(2, 2, 1, "saturation"),
    "arx": Arx(2, 2, 1),
    "bj": BoxJenkinsRecipe(2, 2, 1, 1, 2),
    "coupled_drives": CoupledDrives(2, 2, 1),
    "hammerstein": Hammerstein(2, 2, 1, "saturation"),
    "hammerstein_wiener": HammersteinWiener(2, 2, 1, "saturation", "polynomial"),
    "motor_profile": MotorProfile(5, -1.5, 2.0),
    "nlarx": NonlinearArx(2, 2, 1),
    "output_error": OutputError(2, 2, 1),
    "process": ProcessModel("P2DZ"),
    "servo_joint": ServoJoint("pd", "polynomial", "sags", 360.0, 3.0, 0.01, 7.4, "polynomial", 0.02),
    "state_space": NonlinearStateSpace(2, 3, 2, "linear", 0.1, "polynomial"),
    "wiener": Wiener(2, 2, 1, "polynomial"),
    "wiener_hammerstein": WienerHammerstein(2, 2, 1),
}
# Criteria for N 300, V 1.6575, d 6, worked out by hand, with the tolerance of the last digit.
CRITERIA = {  # N ln V = 151.593, N (1 + ln 2 pi) = 851.363, ln N = 5.70378
    "aic": (1014.956, 1e-3),  # 151.593 + 851.363 + 12
    "aicc": (1015.243, 1e-3),  # and 84 / 293
    "bic": (1037.179, 1e-3),  # 151.593 + 851.363 + 6 * 5.70378
    "fpe": (1.7252, 5e-5),  # 1.6575 * 306 / 294
    "naic": (0.5453, 5e-5),  # 0.505310 + 12 / 300
}
# How far the size that a signature measures may be from the true one, as part of it, and why not less.
STEADY = (2e-3, "a steady state, and a line through several of them")
SIGNATURES = {
    "friction": STEADY,
    "asymmetry": STEADY,
    "stribeck": (0.02, "speed is taken over 0.02 s, in which a joint that breaks loose loses a part of its friction"),
    "hunting": (0.02, "the integral winds on between two looks of the board, and motion shows a sample later"),
    "load_friction": (3e-3, "the start of a ramp's motion, extrapolated over a slightly turning moment arm"),
    "end_stops": (2e-3, "the stop is stiff, not rigid: 0.02 of 52 degrees"),
    "backlash": (2e-3, "the play's stop gives by as much"),
    "pwm": (1e-6, "a difference of two voltages"),
    "dead_band": STEADY,
    "sag": (1e-4, "Ohm's law, on a motor that creeps by nothing else than the friction's own give"),
    "delay": (1e-3, "a settled line's extrapolation; delays are whole milliseconds"),
    "nonlinearity": (1e-3, "the largest of samples 0.3 degrees apart"),
    "noise": (4 / math.sqrt(2 * 3000), "four standard errors of a deviation from 3000 samples"),
    "adc": (1e-6, "a difference of two codes"),
    "jitter": (4 / math.sqrt(2 * 2400), "four standard errors of a deviation from some 2400 samples"),
    "dropouts": (4 / math.sqrt(0.002 * 200_000), "four standard errors of a count that is Poisson's"),
    "gravity": (2e-3, "speed lags behind the weight, which changes along the way"),
    "contact": (2e-3, "the rubber foot gives by a fraction of a millimetre"),
}
# Other values of what they measure, some by much, so that no signature can be right by chance.
OTHER_SIZES = {
    **{"shoulder.coulomb": 1.3, "shoulder.bearing_coulomb": 0.2, "shoulder.viscous": 0.4},
    **{"shoulder.asymmetry": -0.25, "shoulder.stribeck": 0.5, "shoulder.stribeck_speed": math.radians(3.0)},
    **{"thigh.load_friction": 0.6, "shank.stroke": 0.06, "shank.retracted_length": 0.16},
    **{"shoulder.backlash": math.radians(0.6), "pwm_bits": 7, "dead_band": 0.5, "supply_resistance": 2.5},
    **{"delay": 0.047, "pot_linearity": 0.003, "pot_noise": math.radians(0.1), "adc_bits": 9},
    **{"sample_jitter": 0.002, "dropout_rate": 0.01, "thigh_mass": 0.6, "gravity": 9.0, "supply_voltage": 14.0},
}
# Angles [rad] by which an imperfection moves a log at least, where that is less than 0.1 degrees.
FAINT: dict[str, float] = {}
# A short good run of every verb that reports, in a folder with a record log.csv of columns u and y and a saved
# model.json of it; --out is added.
LOGS = Path(__file__).parent / "saved" / "logs"  # two logs of one experiment on the shoulder
VERBS = {
    "calibrate": ["leg.csv", "--joint", "shoulder", "--free", "upper,no_load_speed"],
    "compare": [str(LOGS / "one.csv"), "--joint", "shoulder", "--against", str(LOGS / "two.csv")],
    "demo": [],
    "crawl": ["--steps", "4", "--robots", "1", "--duration", "2"],
    "design": ["leg.csv", "--for", "breakaway"],
    "export": ["model.json", "--c", "--python"],
    "identify": ["log.csv", "--ts", "0.1", "--structure", "output_error", "--orders", "1,1,1"],
    "info": ["--joint", "thigh"],
    "reproduce": ["--duration", "60"],
    "run": ["model.json", "log.csv", "--ts", "0.1", "--horizon", "2"],
    "simulate": ["--duration", "5"],
}


def write_lag(folder):
    """log.csv, a record of y_t = 0.8 y_{t-1} + u_{t-1}, and model.json, a saved model of it."""
    u = np.repeat(np.random.default_rng(2).uniform(-1.0, 1.0, 60), 4)
    y = np.zeros(240)
    for t in range(1, 240):
        y[t] = 0.8 * y[t - 1] + u[t - 1]
    rows = "".join(f"{a!r},{b!r}\n" for a, b in zip(u.tolist(), y.tolist(), strict=True))
    (folder / "log.csv").write_text("u,y\n" + rows)
    sysid.fit(sysid.structures.output_error(1, 1, 1), sysid.IOData(u, y, 0.1)).save(folder / "model.json")


def without(words, option):
    """The words of a command without this option and its value."""
    k = words.index(option) if option in words else len(words)
    return [*words[:k], *words[k + 2 :]]
