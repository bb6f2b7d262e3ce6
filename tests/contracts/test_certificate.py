"""Certified values hold by routes of their own, proofs refuse what is wrong, and digits count what they say."""

import json
import sys
from dataclasses import replace
from decimal import Decimal, localcontext
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from sysid.bench.certificate import static
from sysid.bench.certificate.digits import MOST, digits, fewest
from sysid.bench.certificate.grade import LEAST, grade, violations
from sysid.bench.certificate.record import FOLDER, chain_of, records
from sysid.bench.certificate.stated import METHODS
from sysid.bench.method import FunctionMethod, Outcome
from sysid.solver.iterate import Options, iterate
from sysid.solver.searches import search

SCRIPTS = Path(__file__).parents[2] / "scripts" / "certificates"
RECORDS = records()
STATED = METHODS[0]


def facts_of(name: str) -> dict:
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="ascii"))


def columns(name: str) -> list[list[str]]:
    rows = [line.split(",") for line in (FOLDER / f"{name}.csv").read_text(encoding="ascii").split()[1:]]
    return [list(column) for column in zip(*rows, strict=True)]


def square_wiener(theta, u, zero):
    """w = c1 x^2 + x, x(t) = b0 u(t-1) - f1 x(t-1)."""
    c1, b0, f1 = theta
    x, y = zero, []
    for k in range(len(u)):
        x = b0 * u[k - 1] - f1 * x if k else zero
        y.append(c1 * x * x + x)
    return y


def limited_hammerstein(theta, u, zero):
    """y(t) = b0 min(u(t-1), upper) - f1 y(t-1)."""
    upper, b0, f1 = theta
    y = [zero]
    for before in u[:-1]:
        y.append(b0 * min(before, upper) - f1 * y[-1])
    return y


@pytest.mark.parametrize(
    ("name", "run"), [("wiener_square", square_wiener), ("hammerstein_limit", limited_hammerstein)]
)
def test_the_gradient_vanishes_at_the_certified_point(name, run):
    """By differences of a sum in 90 digits, over 1e-25: they err by 1e-50, the 40 printed digits by 1e-38."""
    with localcontext() as context:
        context.prec = 90
        u, y = ([Decimal(text) for text in column] for column in columns(name))
        facts = facts_of(name)
        centre = [Decimal(text) for text in facts["proof"]["centre"].values()]

        def rss(theta):
            return sum((a - b) ** 2 for a, b in zip(run(theta, u, Decimal(0)), y, strict=True))

        def slope(i, at):
            step = Decimal(10) ** -25
            ends = [rss([v + s * step * (k == i) for k, v in enumerate(at)]) for s in (1, -1)]
            return (ends[0] - ends[1]) / (2 * step)

        assert max(abs(slope(i, centre)) for i in range(len(centre))) < Decimal(10) ** -34
        off = [centre[0] * (1 + Decimal(10) ** -11), *centre[1:]]
        assert abs(slope(0, off)) > Decimal(10) ** -14  # the eleventh digit would be seen
        assert abs(rss(centre) / Decimal(facts["rss"]) - 1) < Decimal(10) ** -18


@pytest.mark.parametrize("name", ["oe_fast", "oe_resonant", "wiener_limits"])
def test_scipy_agrees(name):
    """Estimates to six digits, deviations to four, by filters and a search of SciPy from the nearer start."""
    record = RECORDS[name]
    names, (block, *_) = list(record.parameters), record.blocks
    u, y = record.data.u[:, 0], record.data.y[:, 0]

    def errors(p):
        v = dict(zip(names, p, strict=True))
        B = [0.0] * block["nk"] + [v[f"linear.b{i}"] for i in range(block["nb"])]
        x = lfilter(B, [1.0, *(v[f"linear.f{j + 1}"] for j in range(block["nf"]))], u)
        return np.clip(x, v.get("output.lower", -np.inf), v.get("output.upper", np.inf)) - y

    start = [record.starts[1][key] for key in names]
    fit = least_squares(errors, start, "3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert fewest(fit.x, record.parameters.values()) > 6.0
    cov = np.linalg.inv(fit.jac.T @ fit.jac) * 2.0 * fit.cost / (len(y) - len(names))
    assert fewest(np.sqrt(np.diag(cov)), record.deviations.values()) > 4.0
    assert digits(2.0 * fit.cost, record.rss) > 9.0


@pytest.mark.parametrize("name", RECORDS)
def test_the_library_agrees_on_the_model(name):
    """Its chain has the certified sum at the certified point, to rounding, and a vanishing gradient."""
    record = RECORDS[name]
    chain = chain_of({"blocks": record.blocks, "fixed": record.fixed})
    values = {**record.fixed, **record.parameters}
    theta = np.array([values[key] for key in chain.names])
    yhat, J = chain.tangent(theta, record.data.u[:, 0])
    e, free = record.data.y[:, 0] - yhat, J[:, chain.free]
    assert digits(float(e @ e), record.rss) > 10.9
    assert np.abs(free.T @ e / np.linalg.norm(free, axis=0) / np.linalg.norm(e)).max() < 1e-10
    assert {n for n, known in zip(chain.names, chain.free, strict=True) if known} == set(record.parameters)


def test_two_minima_are_what_they_are_called():
    """Of one pole for two: both are stationary, the second is higher, and a search from the first start ends there."""
    record, facts = RECORDS["oe_two_minima"], facts_of("oe_two_minima")
    second = {name: float(text) for name, text in facts["second_minimum"]["centre"].items()}
    assert record.is_global
    assert float(facts["second_minimum"]["rss"]) > 2.0 * record.rss
    values = STATED.fit(record.task(1).data(5.0, 0)).details["values"]
    assert values == pytest.approx(second, rel=1e-7)
    assert METHODS[1].fit(record.task(1).data(5.0, 0)).details["values"] == pytest.approx(record.parameters, rel=0.01)


def test_the_set_is_as_its_page_says():
    kinds = {name.split("_")[0] for name in RECORDS}
    assert kinds == {"oe", "hammerstein", "wiener", "hw", "wh", "play", "joint"}
    assert len(RECORDS) == 38
    assert sum(record.is_global for record in RECORDS.values()) == 14
    assert {record.level for record in RECORDS.values()} == set(static.LEVELS)
    assert sum(path.stat().st_size for path in FOLDER.parent.rglob("*") if path.suffix in (".csv", ".json")) < 400_000


def test_digits_of_known_errors():
    assert [digits(1.0 + 10.0**-k, 1.0) for k in (2, 5)] == pytest.approx([2.0, 5.0], abs=1e-6)
    assert (digits(3.0, 3.0), digits(7.0, 3.0), digits(None, 1.0), digits(np.nan, 1.0)) == (MOST, 0.0, 0.0, 0.0)
    assert (digits(1e-4, 0.0), digits(-2.0, 2.0)) == (pytest.approx(4.0), 0.0)
    assert fewest([1.0, 2.002], [1.0, 2.0]) == pytest.approx(3.0)


@pytest.mark.parametrize("start", [1, 2])
def test_lower_difficulty_has_the_digits_of_the_rule(start):
    chosen = [grade(STATED, RECORDS[name], start) for name in ("oe_fast", "play_before", "wh_square", "hw_square")]
    assert violations(chosen, (), "stated") == []
    assert min(row.parameters for row in chosen) > LEAST + 1.0
    assert min(row.deviations for row in chosen) > LEAST
    assert min(row.rss for row in chosen) > 10.0


def test_a_wrong_certified_value_makes_the_grade_fall():
    record = RECORDS["oe_slow"]
    for key, change in (("parameters", 1e-5), ("deviations", 1e-4)):
        wrong = {**getattr(record, key), "linear.f1": getattr(record, key)["linear.f1"] * (1.0 + change)}
        row = grade(STATED, replace(record, **{key: wrong}), 2)
        assert getattr(row, key) == pytest.approx(-np.log10(change), abs=0.1)
    row = grade(STATED, replace(record, rss=record.rss * 1.01, parameters={"linear.b0": 1.0}), 2)
    assert (row.rss, row.parameters) == (pytest.approx(2.0, abs=0.1), pytest.approx(0.0, abs=0.1))
    (sentence,) = violations([row], (), "stated")
    assert sentence.startswith("oe_slow, start 2: 0.0 digits, fewer than 6")


def test_a_method_that_fails_or_tells_little_has_a_row():
    def fails(data):
        raise ValueError("no idea")

    row = grade(FunctionMethod("bad", "", fails), RECORDS["oe_fast"], 1)
    assert (row.parameters, row.deviations, row.rss, row.status) == (0.0, 0.0, 0.0, "crashed: ValueError: no idea")

    class Silent:
        name, about = "silent", ""

        def __init__(self, **details):
            self.details = details

        def solve(self, task, tests, seconds, seed):
            chain = chain_of(task.model)
            theta = [RECORDS["oe_fast"].parameters[n] for n in chain.names]
            return Outcome("ok", {name: chain.simulate(theta, u) for name, (u, _) in tests.items()}, self.details)

    told = {"linear.b0": RECORDS["oe_fast"].parameters["linear.b0"]}
    assert grade(Silent(values=told), RECORDS["oe_fast"], 1).parameters == 0.0  # the worst is the one that is missing
    row = grade(Silent(), RECORDS["oe_fast"], 1)
    assert (row.parameters, row.deviations) == (None, None)
    assert row.rss > 10.9
    assert len(violations([row], (), "silent")) == 1


# Runs with fewer than six digits, and why: the first steps lead to where the function does not depend on a parameter.
MISSED = {("BoxBOD", 1), ("MGH10", 1), ("MGH17", 1)}


def test_digits_of_the_solver_on_the_sets_of_nist():
    rows = [static.grade(each, start) for each in static.references().values() for start in (1, 2)]
    assert len(rows) == 54
    assert {(row.name, row.start) for row in rows if row.parameters < LEAST} == MISSED
    assert violations((), rows, "") == []
    held = [row for row in rows if (row.name, row.start) not in MISSED and row.name != "Lanczos1"]
    assert min(row.deviations for row in held) > LEAST  # Lanczos1: rss of 1e-25 is below what doubles hold
    assert min(row.rss for row in held) > 9.0


@pytest.mark.parametrize("name", static.references())
def test_functions_are_those_that_nist_certifies(name):
    """The certified parameters give the certified sum, without any search."""
    each = static.references()[name]
    e = each.problem.residual(each.parameters)
    if name == "Lanczos1":  # its errors are below the eleventh digit of its parameters, where these are rounded
        assert np.abs(e).max() < 1e-10
    else:
        assert digits(float(e @ e), each.rss) > (6.0 if name == "Lanczos2" else 8.0)


def test_a_search_for_more_digits_is_not_ended_by_a_fixed_share():
    """Thurber creeps: its loss falls by less than 1e-5 of itself long before six digits hold."""
    each = static.references()["Thurber"]
    exact = iterate(each.problem, each.starts[1], search("auto"), static.EXACT)
    usual = iterate(each.problem, each.starts[1], search("auto"), Options(tolerance=0.01, grain=0.0))
    assert fewest(exact.p, each.parameters) > 7.0
    assert exact.stop.iterations > usual.stop.iterations


@pytest.fixture(scope="module")
def certifier():
    """The program that certifies, where mpmath is installed."""
    pytest.importorskip("mpmath")
    sys.path.insert(0, str(SCRIPTS))
    try:
        import certify

        yield certify
    finally:
        sys.path.remove(str(SCRIPTS))


@pytest.mark.parametrize("name", ["oe_negative", "hammerstein_gain", "joint_friction"])
def test_records_are_made_again_to_every_digit(certifier, name):
    (plan,) = [plan for plan in certifier.PLANS if plan.name == name]
    facts, u, y = certifier.certified(plan)
    assert [[repr(v) for v in column] for column in (u.tolist(), y.tolist())] == columns(name)
    assert json.loads(json.dumps(facts)) == facts_of(name)


def problem_of(certifier, name):
    (plan,) = [plan for plan in certifier.PLANS if plan.name == name]
    return plan, certifier.Problem(plan.blocks, plan.fixed, list(plan.free), *columns(name))


def test_proofs_refuse_another_point(certifier):
    """A point beside the stationary one has no box, and a lower one elsewhere is seen."""
    facts = facts_of("oe_negative")
    plan, problem = problem_of(certifier, "oe_negative")
    point = [float(v) for v in facts["parameters"].values()]
    spread = [float(v) for v in facts["deviations"].values()]
    beside = [certifier.mp.mpf(v) * 1.2 for v in point]
    with pytest.raises(ArithmeticError, match="no box was proved"):
        certifier.krawczyk(problem, beside, 50)
    sides = [[plan.domain[key][k] for key in plan.free] for k in (0, 1)]
    with pytest.raises(ArithmeticError):
        certifier.lowest(problem, [v * 1.2 for v in point], spread, *sides, most=20_000)


def test_a_box_of_two_minima_is_not_one_of_a_single_point(certifier):
    """Krawczyk's test fails on a box that holds both, and holds on a small one."""
    from jets import slopes_of_intervals
    from mpmath import iv
    from proofs import _contracts, _matrix

    _, problem = problem_of(certifier, "oe_two_minima")
    certifier.mp.dps = iv.dps = 50
    point = [certifier.mp.mpf(text) for text in facts_of("oe_two_minima")["proof"]["centre"].values()]
    inverse = _matrix(problem.loss(point, certifier.mp.mpf, certifier.slopes_of_reals).hessian) ** -1
    exact = problem.loss([iv.mpf(v) for v in point], iv.mpf, slopes_of_intervals)
    for width, holds in ((1e-4, True), (0.5, False)):
        around = problem.loss([iv.mpf([v - width, v + width]) for v in point], iv.mpf, slopes_of_intervals)
        assert _contracts(inverse, exact, around, [certifier.mp.mpf(width)] * 2) == holds


def test_a_higher_minimum_is_not_proved_the_lowest(certifier):
    """The second of two minima: every rule but the bounds of the sum would let it pass."""
    plan, problem = problem_of(certifier, "oe_two_minima")
    point = [float(v) for v in facts_of("oe_two_minima")["second_minimum"]["centre"].values()]
    sides = [[plan.domain[key][k] for key in plan.free] for k in (0, 1)]
    with pytest.raises(ArithmeticError, match=r"do not suffice|as small as a number"):
        certifier.lowest(problem, point, [0.05, 0.05], *sides, most=8_000)


def test_intervals_are_rounded_outward(certifier):
    """Sums, products and squares of doubles lie strictly inside, as exact fractions."""
    from boxes import Boxes

    a, b = np.float64(0.1), np.float64(-0.7)
    exact = [Fraction(float(a)) + Fraction(float(b)), Fraction(float(a)) * Fraction(float(b)), Fraction(float(b)) ** 2]
    x, y = Boxes(np.array([a])), Boxes(np.array([b]))
    for value, box in zip(exact, (x + y, x * y, y**2), strict=True):
        assert Fraction(float(box.lo[0])) < value < Fraction(float(box.hi[0]))
    wide = Boxes(np.array([-1.0]), np.array([2.0])) ** 2
    assert (wide.lo[0], wide.hi[0]) == (0.0, pytest.approx(4.0))


def test_intervals_hold_what_they_enclose(certifier):
    """Sums, gradients and Hessians of points of a box lie within those of the box, kinks included."""
    from boxes import Boxes, slopes_of_boxes
    from jets import slopes_of_reals

    rng = np.random.default_rng(3)
    for name in ("wiener_limit", "play_before", "hammerstein_square"):
        _, problem = problem_of(certifier, name)
        centre = np.array([float(v) for v in facts_of(name)["parameters"].values()])
        half = 0.05 * np.abs(centre)
        box = problem.loss([Boxes(np.array([c - h]), np.array([c + h])) for c, h in zip(centre, half, strict=True)],
                           lambda text: Boxes(np.float64(text)), slopes_of_boxes, False)  # fmt: skip
        for _ in range(40):
            p = centre + half * rng.uniform(-1.0, 1.0, len(centre))
            at = problem.loss([float(v) for v in p], float, slopes_of_reals, False)
            assert box.value.lo[0] <= at.value <= box.value.hi[0]
            for inner, outer in zip(at.gradient, box.gradient, strict=True):
                assert outer.lo[0] - 1e-12 <= inner <= outer.hi[0] + 1e-12
