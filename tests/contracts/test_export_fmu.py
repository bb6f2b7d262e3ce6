"""FMUs in FMPy: valid, the fit's run sample by sample, tunable, resettable, saved and loaded; several at once."""

import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
import zipfile
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from cases import BLOCKS
from exported import FITS, agrees, compiler, excitation, made, structure_fit

from sysid import InputError
from sysid.blocks import TransferFunction
from sysid.estimation.origin import Origin
from sysid.export import fmu as export_fmu
from sysid.model.chain import Chain

fmpy = pytest.importorskip("fmpy", reason="fmpy is in the test extra")
validate_fmu = pytest.importorskip("fmpy.validation").validate_fmu
Ts = 0.1
KINDS = ("CoSimulation", "ModelExchange")
MOST = 2e-15  # of the output's range, as in test_export_c.py: without a smooth linkage and monomials there is none


@pytest.fixture(scope="module")
def units(tmp_path_factory):
    """FMUs by structure and version, each made once: the fit, an input of N samples, and the file."""
    compiler()
    folder, made_units = tmp_path_factory.mktemp("fmu"), {}

    def unit(name, version="3.0"):
        if (name, version) not in made_units:
            fit, u = structure_fit(name)
            written = export_fmu.write(fit, folder / f"{name}_{version[0]}.fmu", version)
            assert written.platform in zipfile.ZipFile(written.path).namelist()[-1]
            made_units[name, version] = fit, u, written.path
        return made_units[name, version]

    return unit


def simulated(path, u, kind, output=("y",), **options):
    """The run of FMPy at the samples of u (N,)."""
    times = Ts * np.arange(len(u))
    signal = np.array(list(zip(times, u, strict=True)), dtype=[("time", float), ("u", float)])
    if kind == "ModelExchange":
        options["record_events"] = False
    return fmpy.simulate_fmu(
        str(path), fmi_type=kind, input=signal, output=list(output), stop_time=times[-1], output_interval=Ts, **options
    )


@contextmanager
def running(path, kind="CoSimulation", **start):
    """An FMU that is initialised, driven call by call, with the references of its variables."""
    description = fmpy.read_model_description(str(path))
    folder = fmpy.extract(str(path))
    try:
        unit = fmpy.instantiate_fmu(folder, description, kind)
        references = {v.name: v.valueReference for v in description.modelVariables}
        begun(unit, references, start)
        yield unit, references
        unit.terminate()
        unit.freeInstance()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def begun(unit, references, start):
    for name, value in start.items():
        unit.setFloat64([references[name.replace("__", ".")]], [value])
    unit.enterInitializationMode(startTime=0.0)
    unit.exitInitializationMode()


def samples(unit, references, u, first=0):
    """y of u: set the input, ask for the output, make the step."""
    y = []
    for k, value in enumerate(u, first):
        unit.setFloat64([references["u"]], [value])
        y += unit.getFloat64([references["y"]])
        unit.doStep(currentCommunicationPoint=k * Ts, communicationStepSize=Ts)
    return np.array(y)


@pytest.mark.parametrize("name", FITS)
def test_every_structure_is_valid_and_gives_the_samples_of_the_fit(name, units):
    fit, u, path = units(name)
    assert validate_fmu(str(path)) == []
    with running(path) as (unit, references):
        y = samples(unit, references, u(2000))
    expected = fit.simulate(u(2000))
    assert np.abs(y - expected).max() <= MOST * np.ptp(expected)


def test_a_joint_with_stops_and_backlash_over_many_samples(units):
    """100,000 samples in FMPy's own loop."""
    fit, u, path = units("joint_with_everything")
    u = u(100_000)
    y, expected = simulated(path, u, "CoSimulation")["y"], fit.simulate(u)
    assert np.abs(y - expected).max() <= MOST * np.ptp(expected)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("version", export_fmu.VERSIONS)
@pytest.mark.parametrize("name", ["joint_with_everything", "output_error"])
def test_both_versions_and_both_kinds(name, version, kind, units):
    fit, u, path = units(name, version)
    assert validate_fmu(str(path)) == []
    u = u(10_000 if "joint" in name else 1_000)
    y, expected = simulated(path, u, kind)["y"], fit.simulate(u)
    assert np.abs(y - expected).max() <= (MOST if "joint" in name else 0.0) * np.ptp(expected)


@pytest.mark.parametrize("version", export_fmu.VERSIONS)
def test_model_exchange_of_a_filter_that_feeds_through(version, tmp_path):
    """At the event of a sample the output is that of the sample, with its own input."""
    compiler()
    fit = made(Chain((TransferFunction(2, 1, 0, role="linear"),)), [0.5, 0.3, -0.7, 0.0])
    path = export_fmu.write(fit, tmp_path / "direct.fmu", version).path
    assert validate_fmu(str(path)) == []
    u = excitation(N=500)
    agrees(simulated(path, u, "ModelExchange")["y"], fit.simulate(u))


def test_parameters_are_tunable_before_and_within_a_run(units):
    fit, u, path = units("hammerstein")
    u = u(600)
    gain = fit.model.names.index("linear.b0")
    changed = replace(fit, theta=np.where(np.arange(len(fit.theta)) == gain, 1.5 * fit.theta, fit.theta))
    agrees(
        simulated(path, u, "CoSimulation", start_values={"linear.b0": changed.theta[gain]})["y"], changed.simulate(u)
    )
    with running(path) as (unit, references):
        y = samples(unit, references, u[:300])
        unit.setFloat64([references["linear.b0"]], [changed.theta[gain]])
        y = np.concatenate([y, samples(unit, references, u[300:], 300)])
    agrees(y[:300], fit.simulate(u)[:300])
    assert not np.allclose(y[300:320], fit.simulate(u)[300:320])
    agrees(y[400:], changed.simulate(u)[400:])  # what was before has died away: 0.7^100 is 3e-16


def test_the_first_position_of_a_joint_can_be_set(units):
    fit, u, path = units("joint_plain")
    u, place = u(300), fit.model.names.index("motor.x0")
    moved = replace(fit, theta=np.where(np.arange(len(fit.theta)) == place, 0.8, fit.theta))
    assert fit.theta[place] != 0.8
    with running(path, motor__x0=0.8) as (unit, references):
        assert unit.getFloat64([references["motor.position"]]) == [0.8]
        agrees(samples(unit, references, u), moved.simulate(u))


def test_two_instances_side_by_side_know_nothing_of_each_other(units):
    fit, u, path = units("joint_plain")
    u, other = u(400), -u(400)
    with running(path) as (a, references), running(path) as (b, _):
        both = [[], []]
        for k in range(400):
            for y, unit, value in ((both[0], a, u[k]), (both[1], b, other[k])):
                y.append(samples(unit, references, [value], k)[0])
    agrees(np.array(both[0]), fit.simulate(u))
    agrees(np.array(both[1]), fit.simulate(other))


def test_reset_and_saved_states(units):
    fit, u, path = units("joint_with_everything")
    u = u(1200)
    expected = fit.simulate(u)
    with running(path) as (unit, references):
        samples(unit, references, u[:700])
        kept = unit.getFMUState()
        data = unit.serializeFMUState(kept)
        first = samples(unit, references, u[700:], 700)
        unit.setFMUState(kept)
        again = samples(unit, references, u[700:], 700)
        unit.freeFMUState(kept)
        unit.reset()
        begun(unit, references, {})
        anew = samples(unit, references, u)
    agrees(first, expected[700:])
    np.testing.assert_array_equal(again, first)
    agrees(anew, expected)
    with running(path) as (unit, references):  # another process would do the same
        unit.setFMUState(unit.deserializeFMUState(data))
        np.testing.assert_array_equal(samples(unit, references, u[700:], 700), first)


def test_steps_of_several_samples_are_taken_and_others_refused(units):
    fit, u, path = units("output_error")
    held = np.repeat(u(100), 3)
    with running(path) as (unit, references):
        y = []
        for k in range(100):
            unit.setFloat64([references["u"]], [held[3 * k]])
            y += unit.getFloat64([references["y"]])
            for refused in (0.05, 0.0, -Ts, 0.25, np.nan):
                with pytest.raises(fmpy.fmi1.FMICallException, match=r"status 2|discard|Discard"):
                    unit.doStep(currentCommunicationPoint=0.3 * k, communicationStepSize=refused)
            unit.doStep(currentCommunicationPoint=0.3 * k, communicationStepSize=0.3)
    agrees(np.array(y), fit.simulate(held)[::3])


def test_a_refused_step_is_said(units):
    _, _, path = units("output_error")
    said = []
    with pytest.raises(fmpy.fmi1.FMICallException):
        fmpy.simulate_fmu(
            str(path), fmi_type="CoSimulation", output_interval=0.07, stop_time=0.7,
            logger=lambda environment, status, category, message: said.append(message.decode()),
        )  # fmt: skip
    assert said == ["a step of 0.070000000000000007 s is not taken; give a multiple of 0.10000000000000001 s"]


def test_the_description_has_units_bounds_and_what_the_output_hangs_on(tmp_path):
    fit, _ = structure_fit("joint_with_everything")
    origin = Origin("voltage & more", "angle", "V", "deg", 100, 99.0)
    path = export_fmu.write(replace(fit, origin=origin), tmp_path / "knee.fmu", u_offset=0.5).path
    description = fmpy.read_model_description(str(path))
    variables = {v.name: v for v in description.modelVariables}
    assert (variables["u"].unit, variables["u"].description, variables["u"].start) == ("V", "voltage & more", "0.5")
    assert (variables["y"].unit, variables["y"].description) == ("deg", "angle")
    gain, delay, position = variables["motor.gain"], variables["motor.delay"], variables["motor.position"]
    assert (gain.variability, gain.unit, gain.min, gain.start) == ("tunable", "1/V/sample", "0.0", "0.0019")
    assert (delay.max, variables["motor.x0"].variability) == ("4.0", "fixed")
    assert (position.causality, position.variability) == ("local", "discrete")
    assert description.defaultExperiment.stepSize == "0.1"
    (output,) = description.outputs
    assert output.dependencies == []  # the position of a sample is there before its voltage acts
    assert description.guid != fmpy.read_model_description(str(_other(fit, tmp_path))).guid


def _other(fit, folder):
    return export_fmu.write(replace(fit, theta=1.01 * fit.theta), folder / "other.fmu").path


def test_several_channels_and_an_output_that_hangs_on_its_input(tmp_path):
    compiler()
    block, theta = BLOCKS["transfer_matrix"]
    fit, u = made(Chain((block,)), theta), excitation(2)
    path = export_fmu.write(fit, tmp_path / "two.fmu").path
    assert validate_fmu(str(path)) == []
    assert [len(o.dependencies) for o in fmpy.read_model_description(str(path)).outputs] == [2, 2]
    with running(path) as (unit, references):
        y = []
        for k, row in enumerate(u):
            unit.setFloat64([references["u1"], references["u2"]], row.tolist())
            y.append(unit.getFloat64([references["y1"], references["y2"]]))
            unit.doStep(currentCommunicationPoint=k * Ts, communicationStepSize=Ts)
    agrees(np.array(y), fit.simulate(u))


@pytest.mark.parametrize("version", export_fmu.VERSIONS)
def test_the_source_compiles_without_warnings_and_has_a_build_description(version, tmp_path, monkeypatch):
    fit, _ = structure_fit("hammerstein")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    written = export_fmu.write(fit, tmp_path / "knee.fmu", version)
    monkeypatch.undo()
    assert written.platform == ""
    archive = zipfile.ZipFile(written.path)
    archive.extractall(tmp_path)
    sources = ["knee.c", "knee_fmu.c"]
    if version == "3.0":
        text = ElementTree.fromstring(archive.read("sources/buildDescription.xml"))
        assert [e.get("name") for e in text.iter("SourceFile")] == sources
    else:
        assert b'<File name="knee.c"/><File name="knee_fmu.c"/>' in archive.read("modelDescription.xml")
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror", "-fsyntax-only"]
    subprocess.run([compiler(), *strict, *sources], cwd=tmp_path / "sources", check=True)


def test_what_cannot_be_written_is_a_sentence(tmp_path, monkeypatch):
    fit, _ = structure_fit("output_error")
    with pytest.raises(InputError, match=r"choose one of 3\.0, 2\.0"):
        export_fmu.write(fit, tmp_path / "knee.fmu", "1.0")
    with pytest.raises(InputError, match="not an identifier"):
        export_fmu.write(fit, tmp_path / "the knee.fmu")
    compiler()
    monkeypatch.setattr(export_fmu, "_FLAGS", ("-no-such-flag",))
    with pytest.raises(InputError, match=r"did not compile the model .*no-such-flag"):
        export_fmu.write(fit, tmp_path / "knee.fmu")
    assert not (tmp_path / "knee.fmu").exists()
