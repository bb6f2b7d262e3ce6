"""Valid arguments of the public calls of `sysid` and `twin`, by name and type, and instances for methods."""

import inspect
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]


class Supply:
    """Valid arguments by the name and the type of a parameter, and instances for methods."""

    def __init__(self) -> None:
        import sysid
        import sysid.data.preprocess
        import twin
        import twin.robot.gait
        from sysid.plots import Run
        from twin.plant import stepping

        blocks, bands, intervals = sysid.blocks, sysid.uncertainty.bands, sysid.uncertainty.intervals
        rng = np.random.default_rng(0)
        chain = sysid.structures.output_error(1, 1, 1)
        u = np.repeat(rng.uniform(-1, 1, 40), 5)
        y = np.zeros(200)
        for k in range(1, 200):
            y[k] = 0.8 * y[k - 1] + 0.4 * u[k - 1]
        data = sysid.IOData(u, y + 0.01 * rng.standard_normal(200), Ts=0.1)
        few = sysid.Options(max_iterations=5)
        fit = sysid.fit(chain, data, starts=1, options=few)
        network = sysid.structures.nlarx(1, 1, 1, units=1)
        joint = sysid.load(ROOT / "tests" / "saved" / "v1" / "joint_jams.json")
        info = sysid.information(fit, data)
        curved = sysid.structures.hammerstein(1, 1, 1, "saturation")
        bent = sysid.information(sysid.fit(curved, data, starts=1, options=few), data)
        curve = sysid.uncertainty.curves.curve(bent, curved.blocks[0].role)
        period = rng.uniform(-1, 1, 50)
        periodic = sysid.IOData(np.tile(period, 4), 0.5 * np.tile(np.roll(period, 1), 4), 0.1)
        bla = sysid.diagnosis.bla.estimate(periodic, 50)
        tested, shown = fit.residual_tests(data), Run(data, y, 50.0)
        higher = sysid.diagnosis.residuals.higher_order_tests(data.y[:, 0] - y, u)
        experiment = twin.Experiment(duration=8.0, Ts=0.1, excitation="steps")
        log = experiment.run()
        board = stepping.step([experiment.prepare()], 0.1, 1.0)[0]
        follower = twin.Follower(log, "thigh", threads=1)
        csv = Path("log.csv").resolve()
        csv.write_text("t,u,y\n" + "".join(f"{k / 10},{a},{b}\n" for k, (a, b) in enumerate(zip(u, y, strict=True))))
        saved = fit.save(Path("fit.json").resolve())
        parameters = twin.Parameters()
        self.by_name: dict[str, Any] = {
            "data": data, "record": data, "fit": fit, "model": chain, "chain": chain, "theta": fit.theta, "u": u,
            "y": y, "e": data.y[:, 0] - y, "Ts": 0.1, "options": few, "info": info, "run": y, "fits": (50.0,),
            "joint": "thigh", "experiment": experiment, "parameters": parameters, "log": log, "label": "one",
            "base": parameters, "number": 2, "seeds": (1,), "draws": twin.Draws(), "folder": "ensemble",
            "path": str(csv), "name": "textbook", "role": "linear", "x": u, "block": chain.blocks[0], "band": None,
            "kind": "saturation", "seed": 1, "threads": 1, "samples": 20, "N": 200, "rng": np.random.default_rng(1),
            "table": str(csv), "columns": {"a": u}, "changes": {"thigh.coulomb": 20.0}, "without": ("friction",),
            "period": 50, "nb": 1, "nf": 1, "course": follower.courses([parameters])[0],
            "coarse": chain, "points": 11, "input": "u", "output": "y", "step": _lag, "mass": 0.05, "length": 0.1,
            "starts": 1, "file": str(csv), "estimation": data, "validation": data, "f": _tanh, "what": "noise",
            "spread": {"thigh.coulomb": 0.1}, "second": log, "duration": 4.0, "standing": 0.5, "steps": 2,
            "excitation": "steps", "draws_": 20, "seconds": 1.0, "column": "u", "curve": None, "duty": 0.5,
            "start": 0, "stop": 100, "signal": u, "text": "a step", "response": None, "values": {},
        }  # fmt: skip
        self.by_owner: dict[tuple[str, str], Any] = {
            ("load", "path"): str(saved), ("Log.load", "path"): str(csv), ("plots.parts", "estimation"): data,
            ("Log.save", "path"): "new.csv", ("save", "path"): "new.json", ("write", "path"): "new.c",
            ("Fit.save", "path"): "new.json", ("joint_values", "fit"): joint, ("excitation", "name"): "steps",
            ("design", "fit"): joint, ("fit_nlarx", "model"): network, ("monte_carlo", "draws"): 20,
            ("mjcf.fragment", "fit"): joint, ("curves.curve", "role"): "linear", ("Chain", "blocks"): chain.blocks,
            ("dynamic", "parameters"): {"gain": 1.0}, ("dynamic", "step"): LAG, ("cross_validate", "folds"): 2,
            ("parameter_file.read", "path"): str(_params()), ("parameter_file.write", "path"): "p.toml",
            ("write_table", "path"): "new.csv", ("fit_joint", "starts"): 1, ("Follower.readings", "parameters"):
            [parameters], ("Follower.courses", "parameters"): [parameters], ("select", "seconds"): 3.0,
            ("compare", "log"): log, ("crawl.run", "draws"): 0, ("searches.search", "name"): "lm",
            ("compare.compare_model", "fit"): sysid.fit(chain, log.io(), starts=1, options=few),
            ("pendulum.respond", "pendulums"): [twin.pendulum.Pendulum(0.05, 0.1)],
            ("pendulum.respond", "starts"): [0.0], ("pendulum.respond", "u"): np.zeros((20, 1)),
            ("Experiment.record", "run"): experiment.prepare(), ("Ensemble.case", "number"): 0,
            ("blocks.static", "role"): "map", ("Custom", "names"): ("gain",), ("Custom", "initial"): (1.0,),
            ("Dynamic", "text"): LAG, ("Dynamic", "names"): ("gain",), ("Dynamic", "first"): (1.0,),
            ("Dynamic", "lower"): (-9.0,), ("Dynamic", "upper"): (9.0,), ("stand", "gait"): twin.robot.gait.Gait(),
        }  # fmt: skip
        self.by_owner |= {
            ("bla.estimate", "data"): periodic, ("find_period", "u"): periodic.u[:, 0], ("parametric", "bla"): bla,
            ("butterworth", "cutoff"): 1.0, ("fill", "values"): y, ("fit_joint", "data"): data[:60],
            ("curves.curve", "info"): bent, ("curves.curve", "role"): curved.blocks[0].role,
            ("intervals.interval", "value"): 1.0, ("intervals.interval", "gradient"): np.ones(len(fit.theta)),
            ("intervals.band", "value"): np.ones(3), ("intervals.band", "x"): np.arange(3.0),
            ("intervals.band", "gradient"): np.ones((3, len(fit.theta))), ("to_toml", "head"): ("one",),
            ("to_toml", "comments"): {}, ("crawl.cycles", "steps"): 4,
            ("plots.bode", "response"):
            sysid.uncertainty.responses.frequency(info), ("plots.comparison", "table"): sysid.compare(data, fit),
            ("plots.free_run", "estimation"): shown, ("plots.free_run", "validation"): shown,
            ("plots.free_runs", "runs"): [shown], ("higher_order_tests", "tests"): higher,
            ("plots.residual_tests", "tests"): tested, ("plots.impulse", "band"):
            sysid.uncertainty.responses.impulse(info), ("plots.step", "band"): sysid.uncertainty.responses.step(info),
            ("plots.steady_state", "band"): intervals.steady_state(info), ("plots.simulated", "band"):
            bands.linear(info), ("pole_zero", "poles"): intervals.poles(info), ("pole_zero_map", "poles"):
            intervals.poles(info), ("static_curve", "curve"): curve, ("static_maps", "curves"): [curve],
            ("plots.usual", "rows"): [("loss", (0.2, 0.3), (0.1, 0.1), "open")],
            ("Experiment.record", "shown"): board, ("merge", "records"): [data], ("sysid.compare", "fits"): [fit],
            ("from_pandas", "table"): data.to_pandas(), ("from_xarray", "table"): data.to_xarray(),
        }  # fmt: skip
        self.instances: dict[str, Any] = {
            "Fit": fit, "Chain": chain, "IOData": data, "Experiment": experiment, "Log": log,
            "NlarxFit": sysid.fit_nlarx(network, data, starts=1, options=few), "Parameters": parameters,
            "Draws": twin.Draws(spread={"thigh.coulomb": 0.1}), "Follower": follower, "Options": few,
            "Ensemble": twin.Ensemble(experiment, (1,), None, "ensemble"),
        }  # fmt: skip
        for kind in sysid.excitations.TABLE.values():
            self.instances[kind.__name__] = kind()
        # Slow calls, with what makes them quick.
        self.quick: dict[str, dict[str, Any]] = {
            "sysid.fit": {"starts": 1, "options": few},
            "sysid.fit_nlarx": {"starts": 1, "options": few},
            "sysid.fit_from": {"options": few},
            "sysid.cross_validate": {"folds": 2, "starts": 1, "options": few},
            "sysid.select": {"seconds": 2.0, "jobs": 1},
            "sysid.fit_joint": {"starts": 1, "parts": ()},
            "twin.Experiment": {"duration": 4.0, "excitation": "steps"},
            "sysid.uncertainty.bands.monte_carlo": {"draws": 20},
            "sysid.blocks.Channels": {"maps": (blocks.Saturation(),)},
            "sysid.blocks.Custom": {"names": ("gain",), "initial": (1.0,)},
            "sysid.blocks.Dynamic": {"names": ("gain",), "first": (1.0,), "lower": (-9.0,), "upper": (9.0,)},
            "sysid.blocks.TransferMatrix": {"entries": ((blocks.TransferFunction(),),)},
            "twin.robot.crawl.run": {"draws": 1, "gait": twin.robot.gait.Gait(cycles=1), "standing": 1.0},
            "twin.compare.compare": {"seconds": 1.0, "values": False, "threads": 1},
        }

        # Calls whose arguments have no names, with names.
        self.named: dict[str, Any] = {"sysid.compare": _compare, "sysid.IOData.merge": _merge}

    def argument(self, owner: str, parameter: inspect.Parameter) -> Any:
        """A valid value; raises KeyError where none is known."""
        for k in range(owner.count(".") + 1):
            key = (owner.split(".", k)[-1], parameter.name)
            if key in self.by_owner:
                return self.by_owner[key]
        return self.by_name[parameter.name]


def _compare(data: Any, fits: Any, labels: Any = None) -> Any:
    import sysid

    return sysid.compare(data, *(fits if isinstance(fits, (list, tuple)) else [fits]), labels=labels)


def _merge(records: Any) -> Any:
    import sysid

    return sysid.IOData.merge(*(records if isinstance(records, (list, tuple)) else [records]))


LAG = "def step(s, x, p):\n    s.level += 0.1 * (p.gain * x - s.level)\n    return s.level\n"


def _lag(s: Any, x: Any, p: Any) -> Any:
    s.level += 0.1 * (p.gain * x - s.level)
    return s.level


def _tanh(x: np.ndarray, theta: np.ndarray) -> np.ndarray:
    return theta[0] * np.tanh(x)


def _params() -> Path:
    path = Path("parameters.toml").resolve()
    path.write_text('["thigh"]\ncoulomb = 20.0\n')
    return path
