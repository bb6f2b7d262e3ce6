"""Residual tests at a prompt and in a notebook."""

from __future__ import annotations

from sysid.base.card import Card, Table
from sysid.base.quantities import number
from sysid.diagnosis.residuals import ResidualTests


def line(tests: ResidualTests) -> str:
    """Both verdicts."""
    return f"<ResidualTests: {_white(tests)}, {_independent(tests)}; {len(tests.lags) - 1} lags>"


def card(tests: ResidualTests) -> Card:
    """The verdicts, what they rest on, and what they mean."""
    n, both, level = len(tests.lags) - 1, len(tests.cross_lags), f"{100 * tests.level:.3g} %"
    rows = [
        (
            "residuals with themselves",
            _white(tests),
            f"{tests.whiteness_outside} of {n}",
            _bound(tests.whiteness_bound),
        ),
        (
            "residuals with the input",
            _independent(tests),
            f"{tests.independence_outside} of {both}",
            _bound(tests.independence_bound),
        ),
    ]
    table = Table(("correlation", "verdict", "lags outside", f"bound, {level}"), rows, text_columns=2)
    facts = [
        ("lags", f"1 to {n} samples, with the input −{n} to {n}"),
        ("chance", f"p = {number(tests.independence_p, 2)} that the input is independent and gives this by chance"),
    ]
    call = 'Next: fit.plot(data, "residuals"), fit.noise_model(data)'
    return Card("Residual tests", facts, [table], [_meaning(tests)], call=call)


def _white(tests: ResidualTests) -> str:
    return "white" if tests.white else "not white"


def _independent(tests: ResidualTests) -> str:
    return "independent" if tests.independent else "not independent"


def _bound(value: float) -> str:
    return f"± {number(value, 2)}"


def _meaning(tests: ResidualTests) -> str:
    """What the two verdicts say about the model."""
    if not tests.independent:
        return (
            "The residuals depend on the input: the model misses something that the input does. Try another delay, "
            "higher orders or another structure: sysid.select(data)."
        )
    if not tests.white:
        return "The residuals are coloured: the noise is, or the model lacks dynamics; see fit.noise_model(data)."
    return "What the model leaves is noise: the record shows nothing that it misses."
