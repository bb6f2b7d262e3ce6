"""What a regression is measured by: a measure looks at pairs of rows of one cell and says which got worse.

Each measure points at one room of the library. They do not overlap: a larger loss on the same structure is the search's
doing; another structure with a loss that is not larger is the selection's; other intervals at the same loss are theirs.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import polars as pl

from sysid.bench.leaderboard import explains_record

SEARCH, SELECTION, RUN, INTERVALS = "search", "selection", "free run", "intervals"
PLACES = {  # where to look first
    SEARCH: "sysid/solver, and `propagate` and `value` of the blocks in sysid/blocks",
    SELECTION: "sysid/selection",
    RUN: "sysid/estimation/initial_state.py, and `simulate` of the result",
    INTERVALS: "sysid/uncertainty, and sysid/solver/covariance.py",
}
SAME_LOSS = 1e-3  # of log loss: searches stop at an expected improvement of 1e-4
SAME_FIT = 0.05  # points of fit
SAME_WIDTH = 0.05  # of log width
SAME_SHARE = 0.1  # of the log of a squared error on unseen data over the loss


@dataclass(frozen=True)
class Measure:
    """`change(pairs)` (n,) is positive where the new row is worse, nan where the measure says nothing of the pair.

    A change within `tolerance` is none. `worse` and `better` are sentences with places: who, w of n pairs changed in
    that direction and b in the other one, size is their median change as `size` writes it.
    """

    name: str
    room: str
    change: Callable[[pl.DataFrame], np.ndarray]
    tolerance: float
    worse: str
    better: str
    size: Callable[[float], str]


def _float(pairs: pl.DataFrame, name: str) -> np.ndarray:
    return pairs[name].cast(pl.Float64).fill_null(float("nan")).to_numpy()


def _log_ratio(pairs: pl.DataFrame, name: str) -> np.ndarray:
    """log(new / base) (n,), nan unless both are positive."""
    new, base = _float(pairs, name), _float(pairs, f"{name}_base")
    positive = (new > 0) & (base > 0)
    return np.log(np.where(positive, new, np.nan) / np.where(positive, base, np.nan))


def _same_structure(pairs: pl.DataFrame) -> np.ndarray:
    return (pairs["structure"] == pairs["structure_base"]).to_numpy()


def lost_fit(pairs: pl.DataFrame) -> np.ndarray:
    """Points of fit that were lost (n,), 100 at most, which is no model at all."""
    return np.clip(_float(pairs, "fit_base"), -100, None) - np.clip(_float(pairs, "fit"), -100, None)


def _grew(pairs: pl.DataFrame) -> np.ndarray:
    """More parameters than before (n,), nan where a structure does not tell them."""
    new, base = (pairs[name].str.extract(r"\bd (\d+)$").cast(pl.Float64) for name in ("structure", "structure_base"))
    return (new - base).fill_null(float("nan")).to_numpy()


def search(pairs: pl.DataFrame) -> np.ndarray:
    """The loss on the same structure."""
    return np.where(_same_structure(pairs), _log_ratio(pairs, "loss"), np.nan)


def _of_search(pairs: pl.DataFrame) -> np.ndarray:
    """Whether the loss changed in the same sense as the fit: both worse, or both better."""
    ratio = _log_ratio(pairs, "loss")
    return (np.abs(ratio) > SAME_LOSS) & (ratio * lost_fit(pairs) > 0)


def choice(pairs: pl.DataFrame) -> np.ndarray:
    """The fit on unseen data where another structure was chosen and its loss does not explain the change."""
    return np.where(~_same_structure(pairs) & ~_of_search(pairs), lost_fit(pairs), 0.0)


def poorer(pairs: pl.DataFrame) -> np.ndarray:
    """The fit where another structure was chosen and its loss changed with the fit."""
    return np.where(~_same_structure(pairs) & _of_search(pairs), lost_fit(pairs), 0.0)


def growth(pairs: pl.DataFrame) -> np.ndarray:
    """Parameters of the chosen structure; more of them are judged with the fit."""
    return _grew(pairs)


def overfit(pairs: pl.DataFrame) -> np.ndarray:
    """Log of the squared error on unseen data over the loss, where another structure was chosen.

    A better model lowers both alike; one that follows the noise of its record lowers the loss alone.
    """
    return np.where(~_same_structure(pairs), 2.0 * _log_ratio(pairs, "rmse") - _log_ratio(pairs, "loss"), 0.0)


def free_run(pairs: pl.DataFrame) -> np.ndarray:
    """The fit on unseen data of the same structure where its loss does not explain the change, or is not told."""
    return np.where(_same_structure(pairs) & ~_of_search(pairs), lost_fit(pairs), np.nan)


def _same_fit(pairs: pl.DataFrame) -> np.ndarray:
    return _same_structure(pairs) & (np.abs(_log_ratio(pairs, "loss")) <= SAME_LOSS)


def width(pairs: pl.DataFrame) -> np.ndarray:
    """Log width of the pole intervals at the same loss; positive is wider, which is judged with the coverage."""
    return np.where(_same_fit(pairs), _log_ratio(pairs, "width"), np.nan)


def coverage(pairs: pl.DataFrame) -> np.ndarray:
    """The share of pole intervals that no longer hold the truth, at the same loss; models that can hold it alone."""
    adequate = pairs.select(explains_record() & explains_record("_base")).to_series().to_numpy()
    with np.errstate(invalid="ignore", divide="ignore"):
        new = _float(pairs, "held") / _float(pairs, "intervals")
        base = _float(pairs, "held_base") / _float(pairs, "intervals_base")
    return np.where(_same_fit(pairs) & adequate, base - new, np.nan)


def claims(pairs: pl.DataFrame) -> np.ndarray:
    """Pole intervals that are no longer claimed."""
    new, base = (np.nan_to_num(_float(pairs, name)) for name in ("intervals", "intervals_base"))
    return np.where(_same_structure(pairs) & ((new > 0) | (base > 0)), base - new, np.nan)


def _times(log: float) -> str:
    return f"{np.exp(log):.3g}"


def _points(change: float) -> str:
    return f"{abs(change):.2f}"


def _integer(change: float) -> str:
    return f"{abs(change):.0f}"


_LOSS = "The loss of {who} on the same structure is {size} times as large on {w} of {n} pairs (median of these), and "
_WIDTH = "The pole intervals of {who} are {size} times as wide on {w} of {n} pairs (median of these)"
WIDTH = Measure("width", INTERVALS, width, SAME_WIDTH, _WIDTH, _WIDTH, _times)
_SIZE = "The structure of {who} has {size} %s parameters (median) on {w} of {n} pairs, and %s on {b}"
GROWTH = Measure("parameters", SELECTION, growth, 0.5, _SIZE % ("more", "fewer"), _SIZE % ("fewer", "more"), _integer)
TABLE = (
    Measure("loss", SEARCH, search, SAME_LOSS, _LOSS + "smaller on {b}", _LOSS + "larger on {b}", _times),
    Measure(
        "poorer choice",
        SEARCH,
        poorer,
        SAME_FIT,
        "The search of {who} ends in another structure with a larger loss and a fit that is {size} points lower on {w} "
        "of {n} pairs",
        "The search of {who} ends in another structure with a smaller loss and a fit that is {size} points higher on "
        "{w} of {n} pairs",
        _points,
    ),
    Measure(
        "choice",
        SELECTION,
        choice,
        SAME_FIT,
        "The choice of {who} is another structure on {w} of {n} pairs whose fit on unseen data is {size} points lower "
        "(median), though its loss is not larger; on {b} pairs the fit is higher",
        "The choice of {who} is another structure on {w} of {n} pairs whose fit on unseen data is {size} points higher "
        "(median); on {b} pairs it is lower",
        _points,
    ),
    GROWTH,
    Measure(
        "overfit",
        SELECTION,
        overfit,
        SAME_SHARE,
        "The squared error of {who} on unseen data, over the loss, is {size} times as large (median) on {w} of {n} "
        "pairs by the choice of another structure, and smaller on {b}",
        "The squared error of {who} on unseen data, over the loss, is {size} times as large (median) on {w} of {n} "
        "pairs by the choice of another structure, and larger on {b}",
        _times,
    ),
    Measure(
        "free run",
        RUN,
        free_run,
        SAME_FIT,
        "The fit of {who} on unseen data is {size} points lower (median) on {w} of {n} pairs though the loss is not "
        "larger, and higher on {b}",
        "The fit of {who} on unseen data is {size} points higher (median) on {w} of {n} pairs, and lower on {b}",
        _points,
    ),
    WIDTH,
    Measure(
        "coverage",
        INTERVALS,
        coverage,
        1e-9,
        "The pole intervals of {who} hold the truth less often on {w} of {n} pairs at the same loss, and more often on "
        "{b}",
        "The pole intervals of {who} hold the truth more often on {w} of {n} pairs at the same loss, and less often on "
        "{b}",
        _points,
    ),
    Measure(
        "claims",
        INTERVALS,
        claims,
        0.5,
        "{who} gives {size} pole intervals fewer (median) on {w} of {n} pairs, and more on {b}",
        "{who} gives {size} pole intervals more (median) on {w} of {n} pairs, and fewer on {b}",
        _integer,
    ),
)
