"""Starts of a chain with one filter between maps: candidates for the poles, by least squares around their poles."""

import numpy as np

from sysid.data.record import IOData
from sysid.estimation.portfolio import hats
from sysid.estimation.portfolio.members import MEMBERS
from sysid.estimation.portfolio.screen import Candidate, Screen
from sysid.estimation.portfolio.surrogate import Surrogate, is_map, line
from sysid.model.chain import Chain

_QUICK = ("approximation", "curved_input")  # members that need no draw and little time
_BEST, _TRIES = 3, 4  # candidates that are varied, and how often


def candidates(chain: Chain, record: IOData, rng: np.random.Generator, turn: int, draw: bool) -> list[Candidate]:
    """Candidates of one round, unsorted; later rounds only draw."""
    linear = chain.linear
    screen = screen_of(chain, record)
    found: list[Candidate] = []
    for name, member in MEMBERS.items():
        if (name in _QUICK or draw) and (turn == 0 or name == "drawn"):
            for f in member(screen, linear, rng):
                found += screen.candidates(name, f)
    return found


def screen_of(chain: Chain, record: IOData) -> Screen:
    """What all candidates of a record share."""
    k = chain.blocks.index(chain.linear)
    before, behind = any(map(is_map, chain.blocks[:k])), any(map(is_map, chain.blocks[k + 1 :]))
    return Screen(record.u[:, 0], record.y[:, 0], chain.linear.nb, chain.linear.nk, before, behind)


def begun(chain: Chain, c: Candidate, record: IOData) -> Surrogate:
    """The chain of straight lines that a candidate describes."""
    screen = screen_of(chain, record)
    linear, x = chain.linear, screen.u
    k = chain.blocks.index(linear)
    blocks, parts = list(chain.blocks), []
    b, w = c.b, c.signal
    for i in range(k):
        if is_map(blocks[i]):
            assert c.curve is not None
            at = hats.places(x, len(c.curve[0]))
            blocks[i] = line(at, blocks[i].role)
            parts.append(np.interp(at, *c.curve))
    if not screen.behind:
        gain = float(np.cov(w, screen.y)[0, 1] / (w.var() or 1.0))
        b, w = gain * b, gain * w
        if screen.before:
            F1, B1 = 1.0 + c.f.sum(), b.sum()
            parts[0] = parts[0] + (float(np.mean(screen.y - w)) * F1 / B1 if abs(B1) > 1e-9 * np.abs(b).max() else 0.0)
    part = np.zeros(linear.n_parameters)
    part[: linear.nb], part[linear.nb : linear.nb + linear.nf] = b, c.f
    parts.append(part)
    for i in range(k + 1, len(blocks)):
        if is_map(blocks[i]):
            at = hats.places(w, 8)
            blocks[i] = line(at, blocks[i].role)
            parts.append(hats.fitted(w, screen.y, at)[0])
    return Surrogate(Chain(tuple(blocks), structure=chain.structure), np.concatenate(parts), member=c.member)
