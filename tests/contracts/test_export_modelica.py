"""The Modelica text of every structure and block: by a reader of its own anywhere, by a compiler where one is there.

The reader (tests/modelica_reader.py) knows the language from its specification. The compiler is Rumoca
(pip install rumoca), which takes no loop in a branch: a motor with stops is for the reader alone.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from cases import BLOCKS, MOVING, VARIANTS
from exported import AT_REST, FITS, changed, excitation, made, structure_fit, with_values
from modelica_reader import Model

from sysid import InputError
from sysid.blocks import Channels, StateSpace, dynamic
from sysid.estimation.origin import Origin
from sysid.export import c as export_c
from sysid.export import modelica
from sysid.model.chain import Chain

CASES = {**{k: v for k, v in BLOCKS.items() if k != "custom"}, **VARIANTS, **MOVING}
# Iterations in branches: at a stop, and in the loop of a servo.
NOT_COMPILED = {"actuated_joint", "joint_coasting", "joint_plain", "joint_with_everything", "motor", "servo_motor"}
NOT_COMPILED |= {f"motor_{part}" for part in ("jams", "loaded", "sided", "swings", "warming", "windage")}
DOUBLE = 5e-15  # of the output's range: measured 8e-16 with either


def agrees(y, expected):
    assert np.ptp(expected) > 0.0
    assert np.abs(y - expected).max() <= DOUBLE * np.ptp(expected)


def block_fit(name):
    block, theta = CASES[name]
    return made(Chain((block,)), theta)


@pytest.fixture(scope="module", params=FITS)
def case(request):
    return structure_fit(request.param)


def test_every_structure_reads_back_to_its_run(case):
    fit, u = case
    agrees(Model(modelica.source(fit)).run(u(800)), fit.simulate(u(800)))


@pytest.mark.parametrize("name", sorted(CASES))
def test_every_block_reads_back_to_its_run_at_the_levels_of_the_record(name):
    fit = block_fit(name)
    n_in, n_out = fit.model.channels
    fit = replace(fit, u_offset=0.5 * np.arange(1, n_in + 1), y_offset=-3.0 * np.arange(1, n_out + 1))
    u = excitation(n_in, 200)
    levels = u + (fit.u_offset if n_in > 1 else fit.u_offset[0])
    agrees(Model(modelica.source(fit)).run(levels), fit.simulate(u) + (fit.y_offset if n_out > 1 else fit.y_offset[0]))


def test_a_changed_parameter_gives_the_model_with_that_parameter(case):
    """Its name is that of `Fit.parameters`, but for words of Modelica (input_)."""
    fit, u = case
    u, rng, model = u(300), np.random.default_rng(1), Model(modelica.source(fit))
    source = export_c.written_source(fit, "model")
    values = {
        p.name: p.start if p.name.endswith(AT_REST) or p.place is None else changed(p, rng.uniform(1.001, 1.02))
        for p in source.parameters
    }
    for name, value in values.items():
        unit, _, own = re.sub(r"^(input|output)\.", r"\1_.", name).partition(".")
        own = re.sub(r"\W", "_", own)
        place = f"{unit}.{own}" if own else unit
        assert place in model.parameters
        setattr(model.space[unit], own, value) if own else model.space.update({unit: value})
    expected = with_values(fit, source, list(values.values())).simulate(u)
    assert np.any(expected != fit.simulate(u))
    agrees(model.run(u), expected)


def test_several_channels_through_several_blocks():
    first = Channels(maps=(BLOCKS["saturation"][0], BLOCKS["polynomial"][0]), role="input")
    matrix = BLOCKS["transfer_matrix"]
    theta = np.concatenate([BLOCKS["saturation"][1], BLOCKS["polynomial"][1], matrix[1]])
    fit, u = made(Chain((first, matrix[0])), theta), excitation(2, 200)
    agrees(Model(modelica.source(fit)).run(u), fit.simulate(u))
    block = StateSpace(nx=2, nu=2, ny=2, units=1, role="linear")
    theta = block.vary(block.start(u), np.random.default_rng(0))
    fit = made(Chain((block,)), theta + 0.05)
    agrees(Model(modelica.source(fit)).run(u), fit.simulate(u))


def test_names_that_mean_something_in_modelica_get_a_sign_behind_them():
    lines = ["def step(s, x, p):", "when = s.end", "s.end += p.each * (p.model * x - when) + p.result"]
    lines += ["go = 1 if when > 0.2 else 0", "for k in range(3):", "    if k > 1 and not go:", "        break"]
    lines += ["    s.end = s.end + 0.001 * k * go", "return when - int(-3.0 * when) * 0.01 * go"]
    block = dynamic("\n    ".join(lines), {"each": 0.3, "model": 1.5, "result": 0.1}, role="algorithm")
    fit, u = made(Chain((block,)), [0.3, 1.2, 0.1]), excitation()
    model = Model(modelica.source(fit, "long_name"))
    assert {"algorithm_.each_", "algorithm_.model_", "algorithm_.result"} <= set(model.parameters)
    agrees(model.run(u), fit.simulate(u))
    with pytest.raises(InputError, match="'model' has a meaning in Modelica; give another name"):
        modelica.source(fit, "model")


def test_units_and_bounds_are_those_of_the_parameters():
    fit, _ = structure_fit("joint_plain")
    text = modelica.source(replace(fit, origin=Origin("drive", "angle", "V", 'deg "of" arc', 100, 99.0)))
    assert '  RealInput u(unit = "V");' in text
    assert "  RealOutput y \"deg 'of' arc\";" in text
    assert re.search(r'    Real rise\(unit = "V", min = 0\.0\) = 1\.9;', text)
    assert re.search(r'    Real delay\(min = 0\.0, max = 4\.0\) = 0\.3 "samples";', text)


@pytest.mark.parametrize("name", [*sorted(CASES), *FITS])
def test_a_compiler_runs_it_to_the_same_numbers(name, tmp_path):
    rumoca = pytest.importorskip("rumoca", reason="rumoca is a Modelica compiler, pip install rumoca")
    fit = block_fit(name) if name in CASES else structure_fit(name)[0]
    n_in, n_out = fit.model.channels if name != "nlarx" else (1, 1)
    u = excitation(n_in, 100).reshape(100, n_in)
    one = (n_in, n_out) == (1, 1)
    rows = ", ".join(f"{{{', '.join(map(repr, row))}}}" for row in u.tolist())
    drive = f"""
model Bench
  exported m;
  constant Real values[100, {n_in}] = {{{rows}}};
  discrete Integer k(start = 1, fixed = true);
{"".join(f"  discrete Real v{j}(start = {float(u[0, j])!r}, fixed = true);{chr(10)}" for j in range(n_in))}
algorithm
  when sample({0.5 * fit.Ts!r}, {fit.Ts!r}) then
    k := pre(k) + 1;
{"".join(f"    v{j} := values[min(k, 100), {j + 1}];{chr(10)}" for j in range(n_in))}
  end when;
equation
{"".join(f"  m.u{'' if one else f'[{j + 1}]'} = v{j};{chr(10)}" for j in range(n_in))}
end Bench;
"""
    (tmp_path / "bench.mo").write_text(modelica.source(fit) + drive)
    if name in NOT_COMPILED:
        with pytest.raises(rumoca.CompileError, match="nested conditionals in every checked branch"):
            rumoca.Session().load(str(tmp_path / "bench.mo"), model="Bench")
        return
    compiled = rumoca.Session().load(str(tmp_path / "bench.mo"), model="Bench")
    run = compiled.simulate(t=(0.0, 99 * fit.Ts), dt=fit.Ts)
    found, time = run.to_dict()["data"], np.array(run.time)
    places = np.searchsorted(time, fit.Ts * (np.arange(100) + 0.3)) - 1
    y = np.stack([np.array(found["m.y" if one else f"m.y[{j + 1}]"])[places] for j in range(n_out)], 1)
    agrees(y, fit.simulate(u[:, 0] if n_in == 1 else u).reshape(100, n_out))
