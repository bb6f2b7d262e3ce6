"""Plants drawn at random: linear filters, chains of a structure, and a nonlinear recursion that is no chain."""

from dataclasses import dataclass, replace

import numpy as np

from sysid.bench.drawing.maps import MAPS
from sysid.block.block import Block, StaticBlock
from sysid.blocks import TransferFunction
from sysid.model.chain import Chain

# Blocks of each structure: L is a linear block, N a static map.
CHAINS = {
    "output_error": "L",
    "hammerstein": "NL",
    "wiener": "LN",
    "hammerstein_wiener": "NLN",
    "wiener_hammerstein": "LNL",
}
RECURSION = "nlarx"
MOST = 4  # poles
LEAST = 0.15  # standard deviation behind a map relative to that before it: below, hardly anything comes through
ROLES = {"NL": ("input", "linear"), "LN": ("linear", "output"), "NLN": ("input", "linear", "output")}
ROLES |= {"L": ("linear",), "LNL": ("linear1", "middle", "linear2")}
KINDS = ("real", "complex", "clustered", "near the circle", "negative")
SINGLE = ("real", "negative")  # kinds of a single pole
SLOWEST = 60.0  # samples of the longest time constant, and a tenth of the record at most


@dataclass(frozen=True)
class Plant:
    """A chain with its true parameters (P,), the orders to tell, and what was drawn in words."""

    chain: Chain
    theta: np.ndarray
    orders: tuple[int, int, int]
    given: str

    def run(self, u: np.ndarray) -> np.ndarray:
        """Noise-free output (N,) from rest."""
        return self.chain.simulate(self.theta, u)

    @property
    def poles(self) -> np.ndarray:
        """Poles in z of all linear blocks."""
        return np.concatenate([block.poles(self.theta[part]) for part, block in self.chain.dynamics])


@dataclass(frozen=True)
class Recursion:
    """y(t) = a1 y(t-1) + a2 y(t-2) + b tanh(c u(t-1)) + d u(t-2) + e y(t-1) tanh(u(t-1)), which stays bounded."""

    a: tuple[float, float]
    b: float
    c: float
    d: float
    e: float
    orders: tuple[int, int, int] = (2, 2, 1)
    poles = None
    chain = None
    theta = None

    @property
    def given(self) -> str:
        """What was drawn."""
        return "two past outputs and inputs, tanh of the input, product of output and input"

    def run(self, u: np.ndarray) -> np.ndarray:
        """Noise-free output (N,) from rest."""
        y1 = y2 = u1 = u2 = 0.0
        out = np.empty(len(u))
        for t, u0 in enumerate(u.tolist()):
            product = self.e * y1 * np.tanh(u1)
            y1, y2 = self.a[0] * y1 + self.a[1] * y2 + self.b * np.tanh(self.c * u1) + self.d * u2 + product, y1
            u1, u2 = u0, u1
            out[t] = y1
        return out


def draw_chain(structure: str, N: int, rng: np.random.Generator) -> Plant:
    """A plant of the structure, without a scale yet; both filters of a Wiener-Hammerstein have the same orders."""
    letters = CHAINS[structure]
    nf = int(rng.integers(1, (MOST if letters.count("L") == 1 else MOST // 2) + 1))
    blocks, parts, words = list[Block](), list[np.ndarray](), list[str]()
    orders = None
    for letter, role in zip(letters, ROLES[letters], strict=True):
        if letter == "N":
            name = str(rng.choice(list(MAPS)))
            block_map, theta = MAPS[name](rng)
            blocks.append(replace(block_map, role=role))
            words.append(f"{role} map {name}")
        else:
            block, theta, kind = draw_filter(rng, N, nf, role, nb=orders and orders[0], nk=orders and 0)
            blocks.append(block)
            orders = orders or (block.nb, block.nf, block.nk)
            words.append(f"{nf} pole(s), {kind}, nb {block.nb}, nk {block.nk}")
        parts.append(theta)
    assert orders is not None
    return Plant(Chain(tuple(blocks), structure=structure), np.concatenate(parts), orders, "; ".join(words))


def scale_gains(plant: Plant, u: np.ndarray) -> Plant | None:
    """The plant with the gains of its linear blocks such that each gives a standard deviation of 1 under u (N,).

    None if a map lets hardly anything through.
    """
    theta, x = plant.theta.copy(), u
    for block in plant.chain.blocks:
        part = plant.chain.index(block)
        y = block.output(theta[part], x)
        if isinstance(block, TransferFunction):
            b = slice(part.start, part.start + block.nb)
            theta[b] /= y.std()
            y = y / y.std()
        elif isinstance(block, StaticBlock) and y.std() < LEAST * x.std():
            return None
        x = y
    return Plant(plant.chain, theta, plant.orders, plant.given)


def draw_recursion(rng: np.random.Generator) -> Recursion:
    """A stable recursion: |a1| + |a2| + |e| below 1 is not needed for its linear part, whose poles lie within 0.9."""
    p = rng.uniform(0.3, 0.85, 2)
    a = (float(p.sum()), float(-p.prod()))
    room = float((1 - p[0]) * (1 - p[1]))  # the product's gain may take away at most half of the damping
    size = rng.uniform(0.1, 0.5) * room * rng.choice([-1.0, 1.0])
    b, d = rng.uniform(0.5, 2.0) * room, rng.uniform(-0.5, 0.5) * room
    return Recursion(a, float(b), float(rng.uniform(0.7, 3.0)), float(d), float(size))


def draw_filter(
    rng: np.random.Generator, N: int, nf: int, role: str, nb: int | None = None, nk: int | None = None
) -> tuple[TransferFunction, np.ndarray, str]:
    """A transfer function, its parameters from rest (P,), and the kind of its poles, for records of N samples.

    Of nf poles one pair is of the drawn kind, the others are real. B has up to three coefficients (nb) and its zeros
    within 1.5 of the origin, the delay nk is up to 4 samples; the steady-state gain is 1 in size.
    """
    slowest = min(SLOWEST, N / 10)
    kind = str(rng.choice(KINDS if nf > 1 else SINGLE))
    z = _pair(kind, rng, slowest)[:nf]
    z = np.concatenate([z, [_real(rng, slowest) for _ in range(nf - len(z))]])
    nb = int(rng.integers(1, min(nf + 1, 3) + 1)) if nb is None else nb
    delay = int(rng.integers(0, 5)) if nk is None else nk
    f, b = np.real(np.poly(z))[1:], np.atleast_1d(np.real(np.poly(_zeros(rng, nb - 1))))
    b = b * (1.0 + f.sum()) / b.sum() * rng.choice([-1.0, 1.0])
    block = TransferFunction(nb, nf, delay, role=role)
    return block, np.concatenate([b, f, np.zeros(block.n_state)]), kind


def _real(rng: np.random.Generator, slowest: float) -> complex:
    return complex(np.exp(-1.0 / np.exp(rng.uniform(np.log(1.5), np.log(slowest)))))


def _pair(kind: str, rng: np.random.Generator, slowest: float) -> np.ndarray:
    """Two poles of the kind; one for a negative pole."""
    if kind == "real":
        return np.array([_real(rng, slowest), _real(rng, slowest)])
    if kind == "negative":
        return np.array([-rng.uniform(0.3, 0.85) + 0j])
    if kind == "clustered":
        first = _real(rng, slowest)
        return np.array([first, 1.0 - (1.0 - first) * rng.uniform(1.02, 1.2)])
    radius = np.exp(-1.0 / rng.uniform(0.5, 1.0) / slowest) if kind == "near the circle" else rng.uniform(0.4, 0.95)
    angle = rng.uniform(0.05, 0.6) * np.pi
    return radius * np.exp(1j * np.array([angle, -angle]))


def _zeros(rng: np.random.Generator, count: int) -> np.ndarray:
    """Real zeros, or a complex pair; none nearer than 0.1 to z = 1, where the gain would vanish."""
    if count == 2 and rng.random() < 0.5:
        zero = rng.uniform(0.2, 1.3) * np.exp(1j * rng.uniform(0.15, 0.9) * np.pi)
        return np.array([zero, zero.conjugate()])
    return rng.uniform(-1.5, 0.9, count).astype(complex)
