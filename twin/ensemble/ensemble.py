"""Ensemble: one experiment over many seeds and drawn parameters, streamed to a folder."""

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base import tables
from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.files import json_value, versions
from sysid.base.locks import file_lock
from sysid.base.parallel import results
from twin.ensemble.draws import Draws
from twin.ensemble.members import SIGNALS, Members, simulate_part
from twin.ensemble.parts import MANIFEST, Parts
from twin.experiment import Experiment
from twin.log import Log
from twin.parameters import JOINTS

if TYPE_CHECKING:
    import polars

SIDE_BY_SIDE = 64  # experiments in a part, at most
SAMPLES = 2**19  # in a part, over all joints, at most, but at least two experiments


@checked(late=True)
@dataclass(frozen=True)
class Ensemble:
    """`experiment` once for each of `seeds`, with the parameters from `draws`; None keeps the parameters.

    Experiment i has seeds[i] in place of the experiment's own seed. Its log equals that of `ensemble.case(i).run()` bit
    for bit, for any number of threads, size of parts and interruption. An experiment that cannot be run, or on which
    MuJoCo fails, is a row with a sentence and a log of NaN.

        ensemble = Ensemble(Experiment("thigh", "aprbs"), range(1000), Draws({"thigh.coulomb": 0.3}), "runs/thigh")
        ensemble.run()
        ensemble.table()       # one row per experiment: seed, drawn parameters, range of the angle
        for log in ensemble:   # one part at a time
            ...

    `run` writes parts of at most `part` experiments to `folder` as Parquet files with one row per experiment, each
    under a temporary name first, and keeps at most three parts in memory. When called again, also after a kill, it
    continues with the missing parts. A second process that runs it meanwhile is refused. The folder's `manifest.json`
    describes the ensemble; a folder of another ensemble raises InputError.

    Raises InputError for seeds or draws that do not fit.
    """

    experiment: Experiment
    seeds: Sequence[int]
    draws: Draws | None
    folder: str | Path
    part: int | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.experiment, Experiment):
            raise InputError(f"experiment is a {type(self.experiment).__name__}; give a twin.Experiment")
        if self.draws is not None and not isinstance(self.draws, Draws):
            raise InputError(f"draws is a {type(self.draws).__name__}; give a twin.Draws or None")
        seeds = self.seeds if isinstance(self.seeds, range) else list(self.seeds)
        for seed in seeds:
            if isinstance(seed, bool) or not isinstance(seed, Integral) or seed < 0:
                raise InputError(f"a seed is {seed!r}; give whole numbers of at least 0, for example range(100)")
        if not seeds:
            raise InputError("there are no seeds; give one per experiment, for example range(100)")
        part = _part_size(self.experiment) if self.part is None else self.part
        if isinstance(part, bool) or not isinstance(part, Integral) or part < 1:
            raise InputError(f"part is {self.part!r}; give a whole number of at least 1")
        object.__setattr__(self, "seeds", tuple(int(seed) for seed in seeds))
        object.__setattr__(self, "part", int(part))
        object.__setattr__(self, "folder", Path(self.folder))
        self.case(0)  # invalid options and draws raise here, before the run

    def __len__(self) -> int:
        return len(self.seeds)

    @checked(late=True)
    def case(self, number: int) -> Experiment:
        """Experiment `number` of the ensemble. Raises InputError if there is none."""
        if not 0 <= number < len(self):
            raise InputError(f"experiment {number} is not in the ensemble; give a number from 0 to {len(self) - 1}")
        return self.members.variant(number)

    @property
    def members(self) -> Members:
        """The experiments, without the folder."""
        return Members(self.experiment, self.seeds, self.draws)

    def describe(self) -> dict[str, Any]:
        """Everything that the logs depend on except software versions, as JSON values."""
        e = self.experiment
        limits = {} if self.draws is None else self.draws.limits(e.p)
        return {
            **{name: getattr(e, name) for name in ("joint", "excitation", "duration", "Ts", "mode", "pot_side")},
            "realisation": e.realisation,
            "without": list(e.without),
            # A default amplitude follows the drawn supply, so both are stored.
            "options": json_value(dict(sorted(e.options.items()))),
            "signals": [json_value(vars(signal)) for signal in e.signals()],
            "parameters": dict(e.p.values),
            "seeds": _seeds(self.seeds),
            "draws": {name: list(span) for name, span in limits.items()},
            "draws_log_uniform": [] if self.draws is None else sorted(self.draws.log_uniform),
            "draws_seed": None if self.draws is None else int(self.draws.seed),
        }

    @checked(late=True)
    def run(
        self,
        threads: int = 0,
        progress: Callable[[int, int], None] | None = None,
        scheduler: str | None = None,
    ) -> "Ensemble":
        """Simulate the missing parts on `threads` threads (0: all processors); returns itself.

        With the address of a Dask `scheduler`, its workers simulate parts with one thread each, and this process writes
        them: the folder need not be shared, the logs are the same. `progress` receives the number of finished
        experiments and the total after every part. Raises InputError for a folder of another ensemble or without write
        access; finished parts are kept.
        """
        if isinstance(threads, bool) or not isinstance(threads, Integral) or threads < 0:
            raise InputError(f"threads is {threads!r}; give a whole number, 0 for all processors")
        if (Path(self.folder) / MANIFEST).is_file() and not self._parts(new=True).missing():
            return self  # which a folder that may only be read allows
        assert isinstance(self.folder, Path)
        tables.check_fork()
        Parts.place(self.folder)
        with file_lock(self.folder, self._locked_message):
            self._run(int(threads), progress, scheduler)
        return self

    def _locked_message(self, owner: str) -> str:
        return (
            f"another run ({owner}) writes to {self.folder}; wait until it ends and run again, or choose another folder"
        )

    def _run(self, threads: int, progress: Callable[[int, int], None] | None, scheduler: str | None) -> None:
        """Write the missing parts; one process at a time."""
        parts, members = self._parts(new=True), self.members
        parts.sweep()
        missing = parts.missing()
        finished_count = len(self) - sum(len(parts.numbers(k)) for k in missing)

        def report(count: int) -> None:
            nonlocal finished_count
            finished_count += count
            if progress is not None:
                progress(finished_count, len(self))

        if scheduler is not None:
            jobs = [(members, parts.numbers(k)) for k in missing]
            for i, table in results(simulate_part, jobs, scheduler=scheduler):
                parts.write(missing[i], table)
                report(len(table))
            return

        def write(k: int, *records: Any) -> int:
            parts.write(k, members.table(*records))
            return len(parts.numbers(k))

        # While one part is simulated, the next is prepared and the previous one is written, so that no processor waits.
        with ThreadPoolExecutor(2) as helpers:
            preparation = [helpers.submit(members.prepare, parts.numbers(k)) for k in missing[:1]]
            writing: list[Future[int]] = []
            for i, k in enumerate(missing):
                part = preparation.pop().result()
                preparation += [helpers.submit(members.prepare, parts.numbers(n)) for n in missing[i + 1 : i + 2]]
                records, trouble = members.simulate(part, threads)
                if writing:
                    report(writing.pop().result())
                writing.append(helpers.submit(write, k, part, records, trouble))
            if writing:
                report(writing.pop().result())

    def table(self) -> "polars.DataFrame":
        """One row per finished experiment: number, seed, redrawn (rejected draws before its own), each drawn parameter
        in its own unit, smallest and largest measured angle [rad], and trouble: why there is no record, "" if there is
        one. Raises InputError if the folder has no part of this ensemble.
        """
        import polars

        tables.check_fork()
        signals = {*self.members.names(SIGNALS), "meta"}
        parts = list(self._read([name for name in self.members.columns() if name not in signals]))
        if not parts:
            raise InputError(f"{self.folder} has no finished part yet; call run() first")
        try:
            return polars.concat(parts)
        except polars.exceptions.PolarsError as error:
            raise InputError(
                f"{self.folder} has parts of other columns ({str(error).splitlines()[0]}); delete the part that was "
                "changed and run the ensemble again"
            ) from None

    def __iter__(self) -> Iterator[Log]:
        """Logs of the finished experiments in order, one part in memory at a time; see `table` for their numbers."""
        joint, names = self.experiment.joint, self.members.names(SIGNALS)
        for part in self._read(["number", *names, "meta"]):
            columns = [part[name].to_numpy() for name in names]
            for i, (number, meta) in enumerate(zip(part["number"], part["meta"], strict=True)):
                u, y, y_true = (np.column_stack([column[i] for column in columns[k::3]]) for k in range(3))
                if joint in JOINTS:
                    u, y, y_true = u[:, 0], y[:, 0], y_true[:, 0]
                yield Log(u, y, self.experiment.Ts, y_true, joint, self._header(number, meta))

    def _read(self, columns: list[str]) -> Iterator["polars.DataFrame"]:
        """These columns of the finished parts; raises InputError for a part of another ensemble."""
        members = self.members

        def is_member(row: dict[str, Any]) -> bool:
            return members.matches_start(row) and members.matches_log(row, self._header(row["number"], row["meta"]))

        return self._parts().read(columns, [*members.row(0)[0], "trouble", "meta"], is_member)

    def _header(self, number: int, text: Any) -> dict[str, Any]:
        """What a row says of its log."""
        try:
            return dict(json.loads(text))
        except (TypeError, ValueError):
            path = self._parts().path(number // self._parts().size)
            raise InputError(f"{path} has a damaged meta in row {number}; delete this file and run again") from None

    def _parts(self, new: bool = False) -> Parts:
        assert isinstance(self.folder, Path)
        assert self.part is not None
        libraries = {name: version for name, version in versions().items() if name in ("qpal", "mujoco", "numpy")}
        return Parts.open(self.folder, len(self), self.part, self.describe(), libraries, new)


def _part_size(experiment: Experiment) -> int:
    """Number of these experiments in a part."""
    return int(np.clip(SAMPLES // (experiment.N * len(experiment.joints)), 2, SIDE_BY_SIDE))


def _seeds(seeds: Sequence[int]) -> dict[str, int] | list[int]:
    """Seeds as JSON: a range is stored as start, step and count."""
    steps = set(np.diff(seeds).tolist()) if len(seeds) > 1 else {1}
    return {"from": seeds[0], "step": steps.pop(), "count": len(seeds)} if len(steps) == 1 else list(seeds)
