"""Ensemble: one experiment over many seeds and drawn parameters, streamed to a folder."""

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from sysid.base import forked
from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.executor import results
from sysid.base.json_values import plain
from sysid.base.lock import held
from sysid.base.versions import versions
from twin.ensemble.draws import Draws
from twin.ensemble.parts import MANIFEST, Parts
from twin.experiment import SETTLE, Experiment
from twin.log import Log
from twin.parameters import JOINTS, TABLE, Parameters
from twin.plant import slots
from twin.plant.leg import bench_spec
from twin.plant.stepping import Run, attempt

if TYPE_CHECKING:
    import polars

SIDE_BY_SIDE = 64  # experiments in a part, at most
SAMPLES = 2**19  # in a part, over all joints, at most, but at least two experiments
COMPILED = tuple(row.name for row in TABLE if row.compiled)  # experiments that agree in these share one compiled model
RANGE = ("angle_min_rad", "angle_max_rad")
SIGNALS = ("voltage_V", "angle_rad", "angle_true_rad")


@dataclass(frozen=True)
class _Case:
    """An experiment ready for simulation, or a sentence with the reason why not; `row` is the start of its row."""

    row: dict[str, Any]
    experiment: Experiment | None
    run: Run | None
    trouble: str


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
        part = _part(self.experiment) if self.part is None else self.part
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
        return replace(self.experiment, seed=self.seeds[number], parameters=self._drawn(number)[0])

    def _drawn(self, number: int) -> tuple[Parameters, int]:
        """The parameters of experiment `number`, and the number of rejected draws before them."""
        if self.draws is None:
            return self.experiment.p, 0
        drawn = self.draws.draw(self.experiment.p, number)
        return drawn.parameters, drawn.redrawn

    def describe(self) -> dict[str, Any]:
        """Everything that the logs depend on except software versions, as JSON values."""
        e = self.experiment
        limits = {} if self.draws is None else self.draws.limits(e.p)
        return {
            **{name: getattr(e, name) for name in ("joint", "excitation", "duration", "Ts", "mode", "pot_side")},
            "realisation": e.realisation,
            "without": list(e.without),
            # A default amplitude follows the drawn supply, so both are stored.
            "options": plain(dict(sorted(e.options.items()))),
            "signals": [plain(vars(signal)) for signal in e.signals()],
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
        forked.check()
        Parts.place(self.folder)
        with held(self.folder, self._taken):
            self._run(int(threads), progress, scheduler)
        return self

    def _taken(self, who: str) -> str:
        return (
            f"another run ({who}) writes to {self.folder}; wait until it ends and run again, or choose another folder"
        )

    def _run(self, threads: int, progress: Callable[[int, int], None] | None, scheduler: str | None) -> None:
        """Write the missing parts; one process at a time."""
        parts = self._parts(new=True)
        parts.sweep()
        left = parts.missing()
        done = len(self) - sum(len(parts.numbers(k)) for k in left)
        if scheduler is not None:
            jobs = [(self, parts.numbers(k)) for k in left]
            for i, table in results(_part_of, jobs, scheduler=scheduler):
                parts.write(left[i], table)
                done += len(table)
                if progress is not None:
                    progress(done, len(self))
            return

        def written(writing: "Future[int]") -> None:
            nonlocal done
            done += writing.result()
            if progress is not None:
                progress(done, len(self))

        # While one part is simulated, the next is prepared and the previous one is written, so that no processor waits.
        with ThreadPoolExecutor(2) as helpers:
            ahead = [helpers.submit(self._prepare, parts.numbers(k)) for k in left[:1]]
            behind: list[Future[int]] = []
            for i, k in enumerate(left):
                cases = ahead.pop().result()
                ahead += [helpers.submit(self._prepare, parts.numbers(following)) for following in left[i + 1 : i + 2]]
                shown, trouble = self._simulate(cases, threads)
                if behind:
                    written(behind.pop())
                behind.append(helpers.submit(self._write, parts, k, cases, shown, trouble))
            if behind:
                written(behind.pop())

    def table(self) -> "polars.DataFrame":
        """One row per finished experiment: number, seed, redrawn (rejected draws before its own), each drawn parameter
        in its own unit, smallest and largest measured angle [rad], and trouble: why there is no record, "" if there is
        one. Raises InputError if the folder has no part of this ensemble.
        """
        import polars

        forked.check()
        signals = {*self._names(SIGNALS), "meta"}
        found = list(self._read([name for name in self._columns() if name not in signals]))
        if not found:
            raise InputError(f"{self.folder} has no finished part yet; call run() first")
        try:
            return polars.concat(found)
        except polars.exceptions.PolarsError as error:
            raise InputError(
                f"{self.folder} has parts of other columns ({str(error).splitlines()[0]}); delete the part that was "
                "changed and run the ensemble again"
            ) from None

    def __iter__(self) -> Iterator[Log]:
        """Logs of the finished experiments in order, one part in memory at a time; see `table` for their numbers."""
        joint, names = self.experiment.joint, self._names(SIGNALS)
        for part in self._read(["number", *names, "meta"]):
            columns = [part[name].to_numpy() for name in names]
            for i, (number, meta) in enumerate(zip(part["number"], part["meta"], strict=True)):
                u, y, y_true = (np.column_stack([column[i] for column in columns[k::3]]) for k in range(3))
                if joint in JOINTS:
                    u, y, y_true = u[:, 0], y[:, 0], y_true[:, 0]
                yield Log(u, y, self.experiment.Ts, y_true, joint, self._header(number, meta))

    def _read(self, columns: list[str]) -> Iterator["polars.DataFrame"]:
        return self._parts().read(columns, [*self._begun(0)[0], "trouble", "meta"], self._is_own)

    def _is_own(self, row: dict[str, Any]) -> bool:
        """Whether a row of a part is of this ensemble: its seed, its drawn values, and the experiment of its log."""
        begun, parameters = self._begun(row["number"])
        if any(row[name] != value for name, value in begun.items()):
            return False
        found = self._header(row["number"], row["meta"])
        if row["trouble"]:  # its log has no header
            return True
        made = replace(self.experiment, seed=begun["seed"], parameters=parameters).meta()
        described = json.loads(json.dumps(made, default=plain))
        return all(found.get(name) == value for name, value in described.items() if name != "versions")

    def _header(self, number: int, text: Any) -> dict[str, Any]:
        """What a row says of its log."""
        try:
            return dict(json.loads(text))
        except (TypeError, ValueError):
            path = self._parts().path(number // self._parts().size)
            raise InputError(f"{path} has a damaged meta in row {number}; delete this file and run again") from None

    def _names(self, names: Sequence[str]) -> list[str]:
        """Columns with these names, one set per driven joint if there are several."""
        if self.experiment.joint in JOINTS:
            return list(names)
        return [f"{joint}.{name}" for joint in self.experiment.joints for name in names]

    def _columns(self) -> list[str]:
        drawn = () if self.draws is None else self.draws.names
        return ["number", "seed", "redrawn", *drawn, *self._names(RANGE), "trouble", *self._names(SIGNALS), "meta"]

    def _parts(self, new: bool = False) -> Parts:
        assert isinstance(self.folder, Path)
        assert self.part is not None
        made_with = {name: now for name, now in versions().items() if name in ("qpal", "mujoco", "numpy")}
        return Parts.open(self.folder, len(self), self.part, self.describe(), made_with, new)

    def _prepare(self, numbers: range) -> list[_Case]:
        models: dict[tuple[float, ...], mujoco.MjModel] = {}
        return [self._prepared(number, models) for number in numbers]

    def _begun(self, number: int) -> tuple[dict[str, Any], Parameters]:
        """The start of the row of experiment `number`: what it was made from; and its parameters."""
        parameters, redrawn = self._drawn(number)
        row: dict[str, Any] = {"number": number, "seed": self.seeds[number], "redrawn": redrawn}
        return row | ({} if self.draws is None else {name: parameters[name] for name in self.draws.names}), parameters

    def _prepared(self, number: int, models: dict[tuple[float, ...], mujoco.MjModel]) -> _Case:
        row, parameters = self._begun(number)
        try:
            experiment = replace(self.experiment, seed=self.seeds[number], parameters=parameters)
            key = tuple(parameters[name] for name in COMPILED)
            if key not in models:
                models[key] = _model(experiment)
            return _Case(row, experiment, experiment.prepare(models[key]), "")
        except InputError as error:  # a valid leg, but not for this excitation
            return _Case(row, None, None, str(error))

    def _simulate(self, cases: Sequence[_Case], threads: int) -> tuple[np.ndarray, list[str]]:
        """Records of the boards (cases, N, joints, COLUMNS), NaN if there is none, with a sentence that says why."""
        e = self.experiment
        shown = np.full((len(cases), e.N, len(e.joints), slots.COLUMNS), np.nan)
        trouble = [case.trouble for case in cases]
        runs = {i: case.run for i, case in enumerate(cases) if case.run is not None}
        if runs:
            shown[list(runs)], said = attempt(list(runs.values()), e.Ts, SETTLE, threads)
            for i, sentence in zip(runs, said, strict=True):
                trouble[i] = sentence
        return shown, trouble

    def _write(self, parts: Parts, k: int, cases: Sequence[_Case], shown: np.ndarray, trouble: Sequence[str]) -> int:
        """Write part k; returns its number of experiments."""
        parts.write(k, self._table_of(cases, shown, trouble))
        return len(cases)

    def _table_of(self, cases: Sequence[_Case], shown: np.ndarray, trouble: Sequence[str]) -> "polars.DataFrame":
        import polars

        forked.check()
        rows, signals = [], []
        for case, rows_of, said in zip(cases, shown, trouble, strict=True):
            values, meta = self._record(case, rows_of)
            with_range = zip(self._names(RANGE), (g(y) for y in values[:, 1] for g in (np.min, np.max)), strict=True)
            meta = meta | {"number": case.row["number"], "trouble": said}
            rows.append(case.row | dict(with_range) | {"trouble": said, "meta": json.dumps(meta)})
            signals.append(values.reshape(-1, values.shape[-1]))
        table = polars.DataFrame(rows, infer_schema_length=None).with_columns(
            polars.Series(name, column) for name, column in zip(self._names(SIGNALS), np.stack(signals, 1), strict=True)
        )
        return table.select(self._columns())

    def _record(self, case: _Case, shown: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
        """Voltage, angle and true angle (joints, 3, N) of a case from its boards' records, and its log's header."""
        if case.experiment is None or case.run is None:
            return np.full((shown.shape[1], len(SIGNALS), shown.shape[0]), np.nan), {}
        log = case.experiment.record(case.run, shown)
        assert log.y_true is not None
        values = np.stack([column.reshape(log.N, -1).T for column in (log.u, log.y, log.y_true)], axis=1)
        return values, dict(log.meta)


def _part_of(job: tuple[Ensemble, range]) -> "polars.DataFrame":
    """The table of some experiments of an ensemble; runs on a worker."""
    ensemble, numbers = job
    cases = ensemble._prepare(numbers)
    return ensemble._table_of(cases, *ensemble._simulate(cases, 1))


def _model(experiment: Experiment) -> mujoco.MjModel:
    """The experiment's bench without textures: they take most of a model's build time and memory."""
    spec = bench_spec(experiment.joint, experiment.p, experiment.without, experiment.realisation)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    return spec.compile()


def _part(experiment: Experiment) -> int:
    """Number of these experiments in a part."""
    return int(np.clip(SAMPLES // (experiment.N * len(experiment.joints)), 2, SIDE_BY_SIDE))


def _seeds(seeds: Sequence[int]) -> dict[str, int] | list[int]:
    """Seeds as JSON: a range is stored as start, step and count."""
    steps = set(np.diff(seeds).tolist()) if len(seeds) > 1 else {1}
    return {"from": seeds[0], "step": steps.pop(), "count": len(seeds)} if len(steps) == 1 else list(seeds)
