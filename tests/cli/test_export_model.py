"""`qpal export MODEL`: what a saved model becomes takes and gives the levels of its record."""

import json
import re
import runpy
import shutil
import subprocess
import sys
import zipfile
from types import SimpleNamespace

import control
import numpy as np
import pytest
from modelica_reader import Model

import sysid
from sysid.blocks import TransferFunction
from sysid.data.preprocess import detrend
from sysid.linear.linearize import tangent_at, tangent_source
from sysid.workflow.saved import export
from twin.cli import main
from twin.report import export as report
from twin.studies.write_back import read_model, write_back

MAIN = """#include <stdio.h>
#include "knee.h"
int main(void)
{
    knee_params p = knee_fit;
    knee_state s;
    double u;
    knee_init(&s, &p);
    while (scanf("%lf", &u) == 1) printf("%.17g\\n", knee_step(&s, &p, u));
    return 0;
}
"""


def record(N=400, seed=0):
    """A lag behind a tanh, about 5 V and -40 units."""
    rng = np.random.default_rng(seed)
    u, y = np.repeat(rng.uniform(-1.0, 1.0, N // 5), 5), np.zeros(N)
    for t in range(1, N):
        y[t] = 0.8 * y[t - 1] + 0.3 * np.tanh(1.5 * u[t - 1])
    return sysid.IOData(u + 5.0, y - 40.0 + 0.002 * rng.standard_normal(N), 0.1, "drive", "height", "V", "m")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder, own = tmp_path_factory.mktemp("export"), detrend(record())
    sysid.fit(sysid.structures.hammerstein(1, 1, 1, "polynomial"), own, starts=2).save(folder / "chain.json")
    sysid.fit(sysid.structures.nlarx(1, 1, 1, units=3, focus="simulation"), own, starts=1).save(folder / "nlarx.json")
    return folder


@pytest.mark.parametrize("kind", ["chain", "nlarx"])
def test_every_file_runs_on_raw_inputs_to_raw_outputs(kind, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    command = [
        "export",
        f"{kind}.json",
        "--c",
        "--fmu",
        "--python",
        "--matlab",
        "--modelica",
        "--control",
        "--name",
        "knee",
        "--out",
        kind,
    ]
    assert main([*command, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["files"] == ["knee.h", "knee.c", "knee.fmu", "knee.py", "knee.m", "knee.mo", "knee_control.py"]
    fit, u = sysid.load(f"{kind}.json"), record(seed=1).u[:, 0]
    assert found["offsets"] == {"u": fit.u_offset.tolist(), "y": fit.y_offset.tolist()}
    expected = fit.simulate(u - fit.u_offset[0]) + fit.y_offset[0]
    assert np.mean(expected) == pytest.approx(-40.0, abs=1.0)
    np.testing.assert_allclose(runpy.run_path(f"{kind}/knee.py")["simulate"](u.tolist()), expected, rtol=0, atol=1e-9)
    np.testing.assert_allclose(Model((folder / kind / "knee.mo").read_text()).run(u), expected, rtol=0, atol=1e-9)
    # On the record itself, once the start is forgotten, the raw run is the fit's own.
    raw = record()
    run = np.array(runpy.run_path(f"{kind}/knee.py")["simulate"](raw.u[:, 0].tolist()))
    np.testing.assert_allclose(run[100:], fit.simulate(raw)[100:], rtol=0, atol=1e-6)
    text = "\n".join(map(repr, u.tolist()))
    for program, build in ((shutil.which("cc"), True), (shutil.which("octave-cli"), False)):
        if program is None:
            continue
        if build:
            (folder / kind / "main.c").write_text(MAIN)
            subprocess.run([program, "-std=c99", "knee.c", "main.c", "-o", "../knee", "-lm"], cwd=kind, check=True)
            done = subprocess.run(["./knee"], input=text, capture_output=True, text=True, check=True)
        else:
            (folder / "u.txt").write_text(text)
            call = f"addpath('{kind}'); printf('%.17g\\n', knee(load('u.txt')))"
            done = subprocess.run(
                [program, "--no-init-file", "--eval", call], capture_output=True, text=True, check=True
            )
        np.testing.assert_allclose(np.array(done.stdout.split(), dtype=float), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", ["chain", "nlarx"])
@pytest.mark.parametrize("at", [None, 5.6])
def test_the_linear_model_is_the_slope_of_the_model(kind, at, folder, monkeypatch, capsys):
    """A small step about the operating point, through the model and through the linear one."""
    monkeypatch.chdir(folder)
    where = [] if at is None else ["--at", str(at)]
    assert main(["export", f"{kind}.json", "--control", *where, "--out", "linear", "--json"]) == 0
    found, fit = json.loads(capsys.readouterr().out)["tangent"], sysid.load(f"{kind}.json")
    space = runpy.run_path(f"linear/{fit.model.structure}_control.py")
    G, u0, y0 = space["G"], space["U0"], space["Y0"]
    assert isinstance(G, control.TransferFunction)
    assert (G.dt, u0, y0) == (0.1, found["u"], found["y"])
    assert u0 == pytest.approx(at if at is not None else 0.5 * sum(fit.u_span) + fit.u_offset[0])
    small, settled = 1e-5, 300
    u = np.where(np.arange(settled + 30) < settled, u0, u0 + small)
    run = fit.simulate(u - fit.u_offset[0]) + fit.y_offset[0]
    assert run[settled - 1] == pytest.approx(y0, abs=1e-9)
    step = np.ravel(control.step_response(G, T=np.arange(30) * 0.1).outputs)
    np.testing.assert_allclose((run[settled:] - y0) / small, step, atol=2e-3 * np.abs(step).max())


def test_a_model_that_integrates_has_a_linear_model_all_the_same():
    from exported import made

    chain = sysid.Chain((TransferFunction(1, 1, 1, role="linear", stability="free"),))
    found = tangent_at(made(chain, [0.5, -1.0, 0.0]), 2.0)
    assert found.integrates
    assert (found.u, found.y) == (2.0, 0.0)
    assert "no steady state: the model integrates" in tangent_source(found, "output_error")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["chain.json", "--c", "--at", "3"], "--at is given without --control"),
        (["chain.json", "--fmu", "--single"], "--single is given without --c"),
        (["chain.json", "--c", "--fmi", "2"], "--fmi is given without --fmu"),
        (["chain.json", "--fmu", "--fmi", "1"], "--fmi is 1; choose one of 3, 2"),
        (["chain.json", "--fmu", "--name", "2 legs"], "not an identifier"),
        (["nlarx.json", "--mjcf"], "a nonlinear ARX model has no motor"),
        (["chain.json", "--matlab", "--name", "end"], "'end' has a meaning in MATLAB"),
        (["chain.json", "--modelica", "--name", "when"], "'when' has a meaning in Modelica"),
        (["nlarx.json", "--control", "--at", "1e9"], "no steady state"),
    ],
)
def test_what_cannot_be_exported_is_a_sentence(arguments, said, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(["export", *arguments]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_the_name_of_a_model_without_one_is_its_structure(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(["export", "chain.json", "--c", "--single", "--fmu", "--fmi", "2", "--out", "named", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"] == ["hammerstein.h", "hammerstein.c", "hammerstein.fmu"]
    assert "float hammerstein_step(" in (folder / "named" / "hammerstein.h").read_text()
    with zipfile.ZipFile("named/hammerstein.fmu") as archive:
        description = archive.read("modelDescription.xml").decode()
    assert 'fmiVersion="2.0" modelName="hammerstein"' in description
    assert 'causality="input" variability="discrete" description="drive"><Real unit="V"' in description


def test_without_a_compiler_the_fmu_has_its_source_and_says_so(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert main(["export", "chain.json", "--fmu", "--out", "bare"]) == 0
    assert "source only: there is no C compiler here" in " ".join(capsys.readouterr().out.split())
    assert "sources/hammerstein.c" in zipfile.ZipFile("bare/hammerstein.fmu").namelist()


def test_a_joint_without_its_means_is_not_written_as_mjcf(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(4)
    u = np.repeat(rng.uniform(-6.0, 6.0, 30), 10)
    y = np.clip(np.cumsum(np.where(np.abs(u) > 2.0, 0.02 * u, 0.0)), -1.0, 1.0) + 0.01 * rng.normal(size=300)
    few = sysid.Options(max_iterations=3)
    data = detrend(sysid.IOData(u, y, 0.1))
    sysid.fit(sysid.structures.actuated_joint(play=False), data, starts=1, options=few).save("model.json")
    assert main(["export", "model.json", "--mjcf"]) == 2
    assert "fit it with --detrend none" in capsys.readouterr().err


def test_onnx_runs_on_raw_inputs_and_without_its_package_is_a_sentence(folder, monkeypatch, capsys):
    runtime = pytest.importorskip("onnxruntime")
    monkeypatch.chdir(folder)
    assert main(["export", "chain.json", "--onnx", "--out", "graph", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["files"] == ["hammerstein.onnx"]
    fit, u = sysid.load("chain.json"), record(seed=1).u
    y, _ = runtime.InferenceSession("graph/hammerstein.onnx").run(None, {"u": u})
    expected = fit.simulate(u[:, 0] - fit.u_offset[0]) + fit.y_offset[0]
    np.testing.assert_allclose(y[:, 0], expected, rtol=0, atol=1e-12)
    monkeypatch.setitem(sys.modules, "onnx", None)
    assert main(["export", "chain.json", "--onnx", "--out", "none"]) == 2
    err = capsys.readouterr().err
    assert "ONNX needs the package onnx, which is not installed: pip install 'qpal[onnx]'" in err
    assert "nothing is written; possible: --c, --fmu, --python, --matlab, --modelica, --control)" in err


@pytest.fixture(scope="module")
def joint(tmp_path_factory):
    """A joint in volts and radians, whose fit was told not to be used."""
    folder = tmp_path_factory.mktemp("joint")
    rng = np.random.default_rng(4)
    u = np.repeat(rng.uniform(-6.0, 6.0, 30), 10)
    y = np.clip(np.cumsum(np.where(np.abs(u) > 2.0, 0.02 * u, 0.0)), -1.0, 1.0) + 0.01 * rng.normal(size=300)
    data = sysid.IOData(u, y, 0.1, "voltage", "angle", "V", "rad")
    few = sysid.Options(max_iterations=3)
    fit = sysid.fit(sysid.structures.actuated_joint(play=False), data, starts=4, options=few)
    fit.save(folder / "model.json")
    return folder


def test_a_way_that_is_not_possible_is_told_before_anything_is_written_with_those_that_are(joint, monkeypatch, capsys):
    monkeypatch.chdir(joint)
    assert main(["export", "model.json", "--c", "--control", "--out", "both"]) == 2
    err = capsys.readouterr().err
    assert "--control: a linear model is written of a chain with one transfer function, and actuated_joint has" in err
    assert "qpal identify LOG --structure output_error" in err
    assert re.search(
        r"nothing is written; possible: --c, --fmu, --python, --matlab(, --onnx)?, --modelica, --mjcf", err
    )
    assert not (joint / "both").exists()


def test_the_free_run_of_a_joint_has_units_on_its_axes(joint):
    result = write_back(read_model(str(joint / "model.json")), ["c"], "joint", None, 0.0, None, joint)
    assert [panel.y.label for panel in report.free_run_figure(result).panels] == ["input u [V]", "output y [deg]"]


def _evaluation(fit, notes, estimation_fit, validation_fit):
    """What `identify` hands to the export, of a model judged in free run."""
    return SimpleNamespace(
        fit=fit,
        notes=notes,
        estimation_fit=estimation_fit,
        validation_fit=validation_fit,
        judged="free run",
        judged_fit=validation_fit,
        tests=None,
    )


def test_what_identify_said_against_a_model_goes_with_its_file(joint, tmp_path, monkeypatch, capsys):
    fit, notes = (
        sysid.load(joint / "model.json"),
        ("the gain has the WRONG SIGN: so it does", "a word on the input map"),
    )
    told = _evaluation(fit, notes, 80.0, -66.2)
    monkeypatch.chdir(tmp_path)
    export(told, tmp_path)
    assert main(["export", "model.json", "--c", "--json", "--out", "out"]) == 0
    found = json.loads(capsys.readouterr().out)
    doubt = "do NOT use this model: the free run fits the validation data to −66.20 %; the gain has the WRONG SIGN"
    assert found["warnings"][0].startswith(doubt)
    assert not any("word on the input map" in text for text in found["warnings"])
    assert main(["export", "model.json", "--matlab", "--out", "out2"]) == 0
    assert "Do NOT use this model: the free run fits" in " ".join(capsys.readouterr().out.split())
    (tmp_path / "plain").mkdir()
    export(_evaluation(fit, (), 80.0, -66.2), tmp_path / "plain")
    assert main(["export", "plain/model.json", "--matlab", "--out", "out3"]) == 0
    assert capsys.readouterr().out.count("NOT use this model") == 1
    good = _evaluation(fit, notes[1:], 99.0, 98.0)
    (tmp_path / "good").mkdir()
    export(good, tmp_path / "good")
    assert sysid.load(tmp_path / "good" / "model.json").warnings == fit.warnings


def test_files_say_in_which_units_they_count_and_no_name_ends_a_comment(tmp_path, capsys):
    """A file's per cent are shares of 1 in the record, and so in the files."""
    data = record()
    rows = np.column_stack([data.t, 100.0 * data.u, data.y])
    head = "time [s],heater */ x [%],height [m]"
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=head, comments="", fmt="%.9g")
    fit = sysid.fit(
        sysid.structures.output_error(1, 1, 1),
        sysid.read(tmp_path / "log.csv", "heater */ x [%]", "height [m]"),
        starts=1,
    )
    fit.save(tmp_path / "model.json")
    assert (
        main(["export", str(tmp_path / "model.json"), "--c", "--python", "--matlab", "--out", str(tmp_path / "o")]) == 0
    )
    assert "In the files u is heater" in capsys.readouterr().out
    for name in ("output_error.h", "output_error.py", "output_error.m"):
        assert "[1] and y is height [m], u as 0.4 for 40 %" in (tmp_path / "o" / name).read_text(encoding="utf-8")
    header = (tmp_path / "o" / "output_error.h").read_text(encoding="utf-8")
    assert "heater */" not in header
