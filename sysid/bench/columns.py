"""The columns of the results table: one row for each scenario, method and seed."""

import polars as pl

KEY = ("scenario", "method", "seed")
BAR = "from_truth"  # the method whose search begins at the truth
DIVERGED = -1e9  # the fit of a run that is not finite; a finite one is at least a tenth of it
UNTRIED = ("no data", "not installed")  # beginnings of a status: the method had no chance
COLUMNS: dict[str, type[pl.DataType]] = {
    "scenario": pl.String,  # family/name
    "method": pl.String,
    "seed": pl.Int64,
    "status": pl.String,  # "ok", or a sentence that says why there is no result
    "fit": pl.Float64,  # free run on unseen data [%], mean over the tests
    "oracle": pl.Float64,  # the same for the noise-free output; nan without a truth
    "rmse": pl.Float64,  # over all tests, in the unit of the scenario
    "errors": pl.String,  # JSON: RMSE of each test
    "loss": pl.Float64,  # mean squared free-run error on the estimation data
    "noise": pl.Float64,  # variance of the noise on it; nan without a truth
    "pole_error": pl.Float64,  # largest matched |s - s true| / |s true|; nan without both
    "map_error": pl.Float64,  # RMS of steady-state output less its truth over the std of the truth; nan without
    "intervals": pl.Int64,  # how many 95 % intervals were claimed
    "held": pl.Int64,  # how many of them hold the truth
    "width": pl.Float64,  # median half width of them, as a share of the true |s| pole
    "seconds": pl.Float64,  # of the fit alone
    "budget": pl.Float64,  # seconds that it was allowed
    "memory": pl.Float64,  # peak of the process during the fit [MiB]
    "stop": pl.String,
    "structure": pl.String,
    "version": pl.String,  # of the method's own library
    "qpal": pl.String,
    "machine": pl.String,
}
