"""What people read: numbers, poles, thinned lines, JSON that every reader accepts."""

import json
import math
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

import sysid
from sysid.base import style
from sysid.base.criteria import criteria
from sysid.base.quantities import display_quantity, estimate, number, percent, poles
from sysid.data.preprocess import detrend
from sysid.data.record import IOData
from sysid.drawing.axes import draw
from sysid.estimation.result import Fit
from sysid.joint.design import TARGETS, Design, Phase
from sysid.joint.values import JointValue
from sysid.report import design, joint, sections, verdict
from sysid.report.joint import values_figure
from sysid.report.page import Grid, to_json
from sysid.solver.covariance import Covariance
from sysid.solver.iterate import Stop
from sysid.workflow.remarks import ends_met, extrapolated_joint, extrapolated_signals
from twin.cli.console import Rounds, Steps
from twin.compare import alignment
from twin.compare.intervals import Value
from twin.report import agreement, compare_words, rig


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1234.5678, "1235"),
        (-0.0123456, "−0.01235"),
        (0.99999, "1.0000"),
        (4.312e-5, "4.312e−5"),
        (-2.5e12, "−2.500e12"),
        (math.nan, "–"),
        (None, "–"),
        (-math.inf, "−∞"),
    ],
)
def test_number(value, text):
    assert number(value) == text


def test_a_fit_far_below_zero_is_not_spelled_out():
    assert percent(71.056) == "71.06 %"
    assert percent(-1e30) == percent(-math.inf) == "< −1000 %"


def test_poles_name_a_pair_once_and_count_equal_ones():
    assert poles([0.5, 0.9 - 0.2j, 0.9 + 0.2j]) == "0.9000 ± 0.2000i, 0.5000"
    assert poles([0.9848, 0, 0, 0, 0]) == "0.9848, 0 (4 times)"
    assert poles([]) == "none"


def test_radians_are_shown_as_degrees_and_nothing_else_is_changed():
    angle = display_quantity("angle", "rad")
    assert angle.label == "angle [deg]"
    assert math.pi * angle.factor == pytest.approx(180.0)
    assert display_quantity("level", "V").label == "level [V]"
    assert display_quantity("u11", "").label == "u11"


def test_a_thinned_line_keeps_every_extreme_and_its_order():
    rng = np.random.default_rng(0)
    y = rng.standard_normal(100_000)
    y[54_321], y[54_322] = 50.0, -50.0  # a glitch of one sample may not vanish from a picture
    x, thin = style.thin(np.arange(len(y)), y)
    assert len(x) <= style.POINTS
    assert np.all(np.diff(x) > 0)
    assert np.array_equal(thin, y[x])
    assert {50.0, -50.0} <= set(thin)


def test_json_has_no_number_that_is_not_one():
    text = to_json({"a": np.array([1.0, np.nan]), "b": -math.inf, "c": np.int64(3), "d": (True, None, "é")})
    assert json.loads(text) == {"a": [1.0, None], "b": None, "c": 3, "d": [True, None, "é"]}
    assert "NaN" not in text
    assert "Infinity" not in text


def test_a_grid_of_some_columns_keeps_what_is_text():
    grid = Grid(("a", "b", "c", "d"), [("1", "2", "3", "4")], text_columns=1, last_text=True)
    part = grid.only("a", "c", "d")
    assert [list(row) for row in part.rows] == [["1", "3", "4"]]
    assert [part.is_text(j) for j in range(3)] == [True, False, True]


def test_a_search_of_several_rounds_moves_one_step_of_the_bar_and_names_its_candidate():
    seen = []
    steps = Steps(lambda done, name: seen.append((done, name)))
    steps("reading")
    steps("fitting")
    rounds = Rounds(steps, 2)
    for done, total, name in ((1, 2, "a"), (2, 2, "b"), (1, 1, "wiener (1,1,1) dead_zone"), (1, 1, "a third round")):
        rounds(done, total, name)
    assert [round(done, 3) for done, _ in seen] == [0, 1, 1.25, 1.5, 2, 2]
    assert seen[4][1] == "round 2: 1 of 1, wiener (1,1,1) dead zone"


def test_a_signal_that_leaves_the_range_seen_is_named_on_its_own_scale():
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-1, 1, 400), rng.uniform(0, 5, 400)
    u[[0, 1, 300]] = -1.0, 1.0, 3.0
    y[[0, 1]] = 0.0, 5.0
    seen, new = detrend(IOData(u, y, 0.1, u_name="voltage", u_unit="V")).split()
    (note,) = extrapolated_signals(seen, new)
    assert note.startswith("voltage was seen from -1 to 1 V")
    assert "to 3 V in the validation data (0.5 % of the samples outside)" in note
    assert extrapolated_signals(new, seen) == []


def joint_between(low: float, high: float) -> Fit:
    """An actuated joint with these ends, as if a search had found it."""
    chain = sysid.structures.actuated_joint(knots=2)
    values = {"map.low": low, "map.high": high, "motor.gain": 0.02, "motor.lag": 0.5, "motor.rise": 1.0}
    values |= {"motor.fall": 1.0, "motor.upper": 1.0, "motor.x0": 0.5}
    theta = np.array([values.get(name, 0.0) for name in chain.names])
    P = len(theta)
    none = Covariance(np.zeros((P, P)), np.zeros(P, dtype=bool), 1.0)
    stop = Stop("", True, 0, 0)
    return Fit(chain, theta, 0.1, criteria(1.0, 400, P), none, stop, (), (), (1.0,), 0.0, "lm", 8)


def driven(volts: float, rests: float, fit: Fit) -> IOData:
    """Ten seconds at these volts, then at others, as the joint would show it."""
    u = np.where(np.arange(400) < 100, volts, rests)
    return IOData(u, fit.model.simulate(fit.theta, u), 0.1, y_name="angle", y_unit="rad")


@pytest.mark.parametrize(("low", "high"), [(-1.0, 3.0), (3.0, -1.0)])
def test_an_end_that_was_never_met_is_named_with_how_far_physics_carries(low, high):
    fit = joint_between(low, high)
    still, up, both = driven(0.0, 0.0, fit), driven(9.0, 0.0, fit), driven(9.0, -9.0, fit)
    assert ends_met(fit, still) == (False, False)
    assert ends_met(fit, up) == ((False, True) if high > low else (True, False))
    assert ends_met(fit, both) == (True, True)
    (note,) = extrapolated_joint(fit, still, both)
    assert "reached neither end" in note
    assert "50.0 % of the travel to -57.3 deg and 50.0 % of the travel to 171.9 deg" in note
    (note,) = extrapolated_joint(fit, up, both)
    assert f"did not reach its {'lower' if high > low else 'upper'} end" in note
    assert f"(50.0 % of the travel to {np.degrees(low):.4g} deg)" in note
    beyond = np.mean((both.y > up.y.max()) | (both.y < up.y.min()))
    assert f"{100 * beyond:.1f} % of the validation samples are outside this range" in note
    assert extrapolated_joint(fit, both, up) == []


@pytest.mark.parametrize(
    ("found", "text"),
    [
        ((180.06, 179.93, 180.19), ("180.06", "179.93", "180.19")),
        ((1.0203, 1.02011, 1.02049), ("1.02030", "1.02011", "1.02049")),
        ((27676.0, 26442.0, 28910.0), ("27700", "26400", "28900")),
        ((1e-3, -0.0491, 0.0509), ("0.001", "−0.049", "0.051")),
        ((1.0, 0.9003, 1.0997), ("1.00", "0.90", "1.10")),  # half is 0.0997, of which two digits are 0.10
        ((2e-5, 1.97e-5, 2.03e-5), ("2.000e−5", "1.970e−5", "2.030e−5")),
        ((-0.0001, -0.04, 0.04), ("0.000", "−0.040", "0.040")),
        ((3.0, 2.0, math.inf), ("3.0", "2.0", "∞")),
        ((0.25, 0.25, 0.25), ("0.2500", "0.2500", "0.2500")),
        ((math.nan, 1.0, 2.0), ("–", "1.000", "2.000")),
    ],
)
def test_an_interval_gives_the_digits_two_of_its_half_width(found, text):
    assert estimate(*found) == text


def test_no_interval_is_rounded_to_nothing():
    """What is read of an interval is as wide as it is, and holds what it holds, to one digit of its half width."""
    rng = np.random.default_rng(0)
    for value, share in zip(10.0 ** rng.uniform(-8, 9, 300), 10.0 ** rng.uniform(-9, 1, 300), strict=True):
        half = value * share
        low, high = (float(x.replace("−", "-")) for x in estimate(value, value - half, value + half)[1:])
        assert 0.5 * (high - low) == pytest.approx(half, rel=0.11), (value, half)


def test_values_of_the_twin_and_of_a_rig_have_the_same_digits():
    found = Value("delay", 0.18006, 0.17993, 0.18019, "s")
    assert compare_words.shown(found, 1e3, "") == ("180.06", "179.93 to 180.19")
    assert agreement._cell(found, 1e3) == "180.06 (179.93 to 180.19)"
    assert rig._cell(JointValue("lag", 1.0203, 1.02011, 1.02049, "s")) == "1.02030 (1.02011 to 1.02049)"
    assert alignment._span(found, 1e3, "ms") == "95 %: 179.93 to 180.19 ms"
    hover = joint._meaning(JointValue("lag", 1.0203, 1.02011, 1.02049, "s"))
    assert hover.endswith("1.02030 s<br>95 % interval 1.02011 to 1.02049 s")


def test_a_physical_value_is_shown_in_degrees_with_the_digits_that_its_interval_means():
    value = JointValue("end_low", np.radians(-10.1234), np.radians(-10.17), np.radians(-10.08), "rad")
    assert sections.value_cells(value) == ("−10.123", "−10.170 to −10.080", "deg")
    assert sections.value_cells(JointValue("delay", 0.02, None, None, "s")) == ("0.02000", sections.NOT_KNOWN, "s")
    unmet = JointValue("end_low", 1.0, None, None, "rad", False, "not reached: beyond 3 deg (it never rests there)")
    assert sections.value_cells(unmet) == ("–", "not reached: beyond 3 deg", "deg")
    none = JointValue("coulomb_up", 0.0, None, None, "duty", False, "below 0.0021 duty (95 %): record slow ramps")
    assert sections.value_cells(none) == ("–", "below 0.0021", "duty")
    hidden = JointValue("backlash", 1.0, None, None, "rad", False, "the link never crosses it")
    assert sections.value_cells(hidden) == ("–", sections.NOT_KNOWN, "deg")
    speed = JointValue("speed_per_volt", np.radians(5.0), np.radians(4.0), np.radians(6.0), "rad/s/V")
    assert sections.value_cells(speed) == ("5.0", "4.0 to 6.0", "deg/s/V")
    assert [str(v) for v in (speed, hidden)] == [
        "speed per volt, mid stroke: 5.0 (4.0 to 6.0) deg/s/V",
        "backlash: 57.30 deg",
    ]


def test_a_backlash_has_an_axis_of_its_own_and_open_points_are_explained():
    ends = [JointValue(name, y, y - 0.01, y + 0.01, "rad") for name, y in (("end_low", -0.5), ("end_high", 0.9))]
    for width in (None, 0.001):
        low, high = (None, None) if width is None else (0.006 - width, 0.006 + width)
        play = JointValue("backlash", 0.006, low, high, "rad", width is not None)
        drawn = draw(values_figure((*ends, play)))
        names = [[tick.get_text() for tick in ax.get_yticklabels()] for ax in drawn]
        assert names == [["lower end stop", "upper end stop"], ["backlash (?)" if width is None else "backlash"]]
        left, right = drawn[1].get_xlim()
        if width is not None:
            assert np.degrees(0.004) < left < np.degrees(0.006) < right < np.degrees(0.008)
        (legend,) = drawn[0].figure.legends
        assert [text.get_text() for text in legend.get_texts()] == ["value, 95 % interval", "not determined"][
            : 2 if width is None else 1
        ]


def test_the_numbers_of_physical_values_stand_apart_and_are_round():
    rows = (("speed_per_volt", 12.75, 0.33, "deg/s/V"), ("backlash", 0.1282, None, "deg"), ("delay", 0.017, 0.005, "s"))
    values = [JointValue(name, x, half and x - half, half and x + half, unit) for name, x, half, unit in rows]
    drawn = draw(values_figure((*values, JointValue("breakaway_up", 2.92, 2.59, 3.26, "V"))))
    figure = drawn[0].figure
    FigureCanvasAgg(figure).draw()
    for ax in drawn:
        ticks = [
            tick for tick in ax.get_xticklabels() if ax.get_xlim()[0] <= tick.get_position()[0] <= ax.get_xlim()[1]
        ]
        boxes = [tick.get_window_extent() for tick in ticks]
        assert len(boxes) > 1
        assert all(a.x1 + 8.0 < b.x0 for a, b in pairwise(boxes))
        step = ticks[1].get_position()[0] - ticks[0].get_position()[0]
        assert f"{step:.0e}"[0] in "125"


@pytest.mark.parametrize(
    "units", [("V", "rad"), ("increments of the pulse generator per millisecond", "revolutions of the gearbox shaft")]
)
def test_labels_of_a_designed_experiment_stand_inside_the_picture(units):
    u = np.repeat([1.0, -1.0], 50)
    drawn = draw(
        design.experiment_figure(
            Design(("ends",), u, np.cumsum(u), 0.1, (Phase("ends", 0, 100, ""),), 1.0, (), (), units)
        )
    )
    figure = drawn[0].figure
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    for ax in drawn:
        label = ax.yaxis.label.get_window_extent(canvas.get_renderer())
        assert figure.bbox.x0 <= label.x0 < label.x1 <= ax.bbox.x0
        assert figure.bbox.y0 <= label.y0 < label.y1 <= figure.bbox.y1
        assert ax.bbox.y0 - 10 <= label.y0 < label.y1 <= ax.bbox.y1 + 10  # beside its own axis


def test_a_design_for_one_thing_counts_the_values_of_that():
    """What it was not asked for is left to the first record."""
    names = ("breakaway_up", "breakaway_down", "end_low", "end_high")
    now = tuple(JointValue(name, 1.0, 0.9, 1.1, "V", name.startswith("end")) for name in names)
    then = tuple(JointValue(name, 1.0, 0.9, 1.1, "V", not name.startswith("end")) for name in names)
    for targets, asked, word in (
        (("breakaway",), names[:2], "good"),
        (tuple(TARGETS), names, "poor"),
    ):
        d = Design(targets, np.ones(2), np.ones(2), 0.1, (), 1.0, now, then)
        assert tuple(v.name for v in design.asked(d)[1]) == asked
        assert design.word(d) == word


@pytest.mark.parametrize(("fits", "words"), [((98.7, 97.0), "stays close to"), ((98.7, 71.8), "not close to them")])
def test_a_free_run_that_misses_a_quarter_of_the_validation_data_is_not_called_close(fits, words):
    e = SimpleNamespace(
        linear=False, stable=True, one_step=None, unseen=True, estimation_fit=fits[0], validation_fit=fits[1]
    )
    assert words in verdict.stability(e)
