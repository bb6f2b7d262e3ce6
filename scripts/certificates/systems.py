"""Outputs of a record's system from its difference equations, over any numbers; written without the library.

A system is a list of blocks in series, as in the records' JSON; every filter begins at rest:

- transfer_function: y(t) = b0 x(t-nk) + .. + b_{nb-1} x(t-nk-nb+1) - f1 y(t-1) - .. - f_nf y(t-nf)
- saturation: y = min(max(x, lower), upper)
- polynomial: y = c1 x^n + .. + c(n+1)
- motor: x' = v, lag v' = gain (u - rise) - v forward and gain (u + fall) - v backward, y(t) = x(t), u held from t to
  t + 1, x and v begin at 0; at rest it stands while -fall <= u <= rise. Between reversals the solution is exact.
- play: y(0) = x(0), y(t) = min(max(y(t-1), x(t) - width / 2), x(t) + width / 2)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from jets import Jet, Slopes, clip, constant


def outputs(
    blocks: Sequence[Mapping[str, Any]], theta: Mapping[str, Jet], u: Sequence[Any], slopes: Slopes
) -> list[Jet]:
    """y (N,) as jets for an input u (N,) of numbers; theta holds every parameter by role.name."""
    like = next(iter(theta.values()))
    known = {id(value): constant(value, like) for value in u}
    x = [known[id(value)] for value in u]
    for block in blocks:
        part = {name.split(".")[1]: value for name, value in theta.items() if name.split(".")[0] == block["role"]}
        x = KINDS[block["kind"]](block, part, x, slopes)
    return x


def _filter(block: Mapping[str, Any], p: Mapping[str, Jet], x: list[Jet], slopes: Slopes) -> list[Jet]:
    y: list[Jet] = []
    for t in range(len(x)):
        terms = [p[f"b{i}"] * x[t - block["nk"] - i] for i in range(block["nb"]) if t >= block["nk"] + i]
        terms += [(p[f"f{j}"] * y[t - j]).scaled(-1) for j in range(1, block["nf"] + 1) if t >= j]
        y.append(_sum(terms) if terms else x[t].scaled(0))
    return y


def _saturation(block: Mapping[str, Any], p: Mapping[str, Jet], x: list[Jet], slopes: Slopes) -> list[Jet]:
    return [clip(value, p["lower"], p["upper"], slopes) for value in x]


def _polynomial(block: Mapping[str, Any], p: Mapping[str, Jet], x: list[Jet], slopes: Slopes) -> list[Jet]:
    y = []
    for value in x:
        total = p["c1"]
        for i in range(2, block["degree"] + 2):
            total = total * value + p[f"c{i}"]
        y.append(total)
    return y


def _play(block: Mapping[str, Any], p: Mapping[str, Jet], x: list[Jet], slopes: Slopes) -> list[Jet]:
    half, y = p["width"].scaled((p["width"].value * 0 + 1) / 2), [x[0]]
    for before, value in pairwise(x):  # of an input that stands still the branch is not certain, and does not matter
        y.append(y[-1] if value is before else clip(y[-1], value - half, value + half, slopes))
    return y


def _motor(block: Mapping[str, Any], p: Mapping[str, Jet], x: list[Jet], slopes: Slopes) -> list[Jet]:
    place = speed = x[0].scaled(0)
    whole = place + 1
    y = []
    for u in x:
        y.append(place)
        left, way = whole, speed.sign()
        while True:
            if way == 0:
                way = 1 if (u - p["rise"]).sign() > 0 else -1 if (u + p["fall"]).sign() < 0 else 0
            if way == 0:
                speed = speed.scaled(0)
                break
            target = p["gain"] * (u - p["rise"] if way > 0 else u + p["fall"])
            away = speed - target
            after = target + away * (left * p["lag"].inverse()).scaled(-1).exp()
            if speed.sign() == 0 or after.sign() == way:
                place, speed = place + target * left + p["lag"] * (speed - after), after
                break
            time = p["lag"] * (away * target.inverse()).scaled(-1).log()
            place = place + target * time + p["lag"] * speed
            left, speed, way = left - time, whole.scaled(0), 0
    return y


def _sum(terms: list[Jet]) -> Jet:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


KINDS = {
    "transfer_function": _filter,
    "saturation": _saturation,
    "polynomial": _polynomial,
    "play": _play,
    "motor": _motor,
}


def loss(
    blocks: Sequence[Mapping[str, Any]], theta: Mapping[str, Jet], u: Sequence[Any], y: Sequence[Any], slopes: Slopes
) -> Jet:
    """Sum of squared errors."""
    return _sum([(yhat - value).square() for yhat, value in zip(outputs(blocks, theta, u, slopes), y, strict=True)])
