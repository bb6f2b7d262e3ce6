"""The signature of each imperfection: a small experiment, its caption, and the size measured in its data."""

from collections.abc import Callable

from sysid.base.checks import checked
from twin.imperfections import TABLE as IMPERFECTIONS
from twin.imperfections import Show, Signature
from twin.parameters import Parameters
from twin.signatures import electronics, friction, lab, mechanics

# In the order of `twin.IMPERFECTIONS`; an imperfection may have more than one. Those that stand with their imperfection
# come from its class.
_TABLE: dict[str, Callable[[Parameters], Signature]] = {
    "friction": friction.friction,
    "asymmetry": friction.asymmetry,
    "stribeck": friction.stribeck,
    "hunting": friction.hunting,
    "load_friction": mechanics.load_friction,
    "end_stops": mechanics.end_stops,
    "backlash": mechanics.backlash,
    "pwm": electronics.pwm,
    "dead_band": electronics.dead_band,
    "sag": electronics.sag,
    "delay": electronics.delay,
    "nonlinearity": electronics.nonlinearity,
    "noise": electronics.noise,
    "adc": electronics.adc,
    "jitter": electronics.jitter,
    "dropouts": electronics.dropouts,
    "gravity": mechanics.gravity,
    "contact": mechanics.contact,
}


def _on_the_bench(show: Show) -> Callable[[Parameters], Signature]:
    return lambda p: show(p, lab)


TABLE = _TABLE | {name: _on_the_bench(each.show) for name, each in IMPERFECTIONS.items() if each.show is not None}


@checked(late=True)
def signatures(
    parameters: Parameters | None = None, begins: Callable[[str], None] = lambda key: None
) -> tuple[Signature, ...]:
    """Every signature, in the order of `TABLE`, in about ten seconds; `begins` is called with each one as it begins."""
    results = []
    for key, make in TABLE.items():
        begins(key)
        results.append(make(parameters or Parameters()))
    return tuple(results)


__all__ = ["TABLE", "signatures"]
