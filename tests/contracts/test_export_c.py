"""NAME.h and NAME.c of every structure: 10^4 samples beside the fit's, changed parameters, single precision, C++."""

import re
import runpy
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from cases import BLOCKS
from exported import (
    AT_REST,
    FITS,
    STRICT,
    Compiled,
    agrees,
    changed,
    excitation,
    made,
    structure_fit,
    with_values,
)

from sysid.blocks import Delay
from sysid.export import c as export_c
from sysid.model.chain import Chain

SAMPLES = 10_000
# Largest difference over these samples, as a share of the output's range. Double: none but where a smooth linkage is
# summed up, monomials are multiplied, or a process goes from state to state, in another order (measured 5e-16, 1e-16
# and 4e-16). Single: measured 1.5e-5, of a
# motor without stops; else 1.5e-6.
DOUBLE, SINGLE = 2e-15, 3e-5
LIBM = {"exp", "log", "sqrt", "pow", "sin", "cos", "acos", "tanh", "floor"}


@pytest.fixture(scope="module", params=FITS)
def case(request, tmp_path_factory):
    """Fit, its run, and the compiled file in double precision."""
    fit, u = structure_fit(request.param)
    return fit, u(SAMPLES), Compiled(fit, tmp_path_factory.mktemp(request.param), request.param)


def test_all_samples_are_those_of_the_fit(case):
    fit, u, compiled = case
    expected = fit.simulate(u)
    assert np.ptp(expected) > 0.0
    difference = np.abs(compiled.run(u) - expected).max()
    other_order = "sum_of" in compiled.source.text or "s->state" in compiled.source.text
    other_order = other_order or fit.model.structure == "process"
    assert difference <= (DOUBLE * np.ptp(expected) if other_order else 0.0)


def test_single_precision_stays_near(case, tmp_path):
    fit, u, _ = case
    expected = fit.simulate(u)
    y = Compiled(fit, tmp_path, "single", single=True).run(u)
    assert 0.0 < np.abs(y - expected).max() < SINGLE * np.ptp(expected)


def test_a_changed_parameter_gives_the_model_with_that_parameter(case):
    """Each alone, and all together; a run of the fit begins at rest."""
    fit, u, compiled = case
    source, u = compiled.source, u[:1500]
    start = np.array([p.start for p in source.parameters])
    free = [k for k, p in enumerate(source.parameters) if p.place is not None and not p.name.endswith(AT_REST)]
    rng = np.random.default_rng(1)
    together = start.copy()
    plain, moved = fit.simulate(u), 0
    for k in free:
        together[k] = changed(source.parameters[k], rng.uniform(1.001, 1.02))
        values = start.copy()
        values[k] = together[k]
        expected = with_values(fit, source, values).simulate(u)
        agrees(compiled.run(u, values), expected)
        moved += bool(np.any(expected != plain))
    assert moved > 0.7 * len(free)
    agrees(compiled.run(u, together), with_values(fit, source, together).simulate(u))


def test_the_source_is_cpp_too_keeps_nothing_and_calls_only_what_it_says(case, tmp_path):
    _, _, compiled = case
    gcc, cpp, nm = (shutil.which(name) for name in ("gcc", "g++", "nm"))
    if not gcc or not cpp or not nm:
        pytest.skip("gcc, g++ and nm are in Debian's build-essential")
    source = compiled.source
    (tmp_path / f"{compiled.name}.h").write_text(source.header)
    file = tmp_path / f"{compiled.name}.c"
    file.write_text(source.text)
    subprocess.run([cpp, "-x", "c++", "-std=c++11", *STRICT, "-fsyntax-only", file], check=True)
    subprocess.run([gcc, "-std=c99", "-O1", "-c", file, "-o", tmp_path / "object"], check=True)
    listed = subprocess.run([nm, tmp_path / "object"], capture_output=True, text=True, check=True).stdout
    kinds = dict(line.split()[-1:-3:-1] for line in listed.splitlines())
    assert not {name for name, kind in kinds.items() if kind in "bBdDC"}
    undefined = {name for name, kind in kinds.items() if kind == "U"} - {"memset", "__stack_chk_fail"}
    assert undefined <= LIBM
    said = re.search(r"libm is needed for ([^:]*):", source.header)
    assert undefined <= (set(said[1].split(", ")) if said else set())
    assert bool(said) != ("It needs no libm." in source.header)


def test_filters_and_maps_of_straight_pieces_need_no_libm():
    for name in ("output_error", "hammerstein", "hammerstein_wiener"):
        assert "math.h" not in export_c.source(structure_fit(name)[0])


def test_offsets_can_be_changed(tmp_path):
    fit, u = structure_fit("hammerstein")
    compiled = Compiled(fit, tmp_path, u_offset=5.0, y_offset=-40.0)
    values = [p.start for p in compiled.source.parameters]
    assert values[-2:] == [5.0, -40.0]
    values[-2:] = [2.0, 1.0]
    agrees(compiled.run(u(400), values), fit.simulate(u(400) - 2.0) + 1.0)


def test_a_delay_beyond_the_memory_is_the_longest_that_there_is_room_for(tmp_path):
    fit, u = made(Chain((Delay(role="line"),)), [3.3]), excitation()
    compiled = Compiled(fit, tmp_path)
    (delay, *_) = compiled.source.parameters
    assert delay.upper == 7.0
    assert "up to 7" in compiled.source.header
    for asked, given in ((6.9, 6.9), (1e9, 7.0), (-1.0, 0.0)):
        expected = made(fit.model, [given]).simulate(u)
        agrees(compiled.run(u, [asked, 0.0, 0.0]), expected)


def test_names_that_mean_something_in_c_get_a_sign_behind_them(tmp_path):
    from sysid.blocks import dynamic

    lines = ["def step(s, x, p):", "y = s.double", "s.double += p.register * (p.while_[0] * x - y) + p.new", "return y"]
    text = "\n    ".join(lines)
    block = dynamic(text, {"register": 0.3, "while_": (1.0, 2.0), "new": 0.1}, role="int")
    fit, u = made(Chain((block,)), [0.3, 1.2, 0.5, 0.1]), excitation()
    agrees(Compiled(fit, tmp_path, "long_name").run(u), fit.simulate(u))


def test_a_state_may_begin_at_a_number_without_a_warning(tmp_path):
    """The beginning reads no parameter, and the step no state but this one."""
    from sysid.blocks import dynamic

    text = "def begin(s, x, p):\n    s.level = 0.5\n\ndef step(s, x, p):\n    s.level += p.rate * (x - s.level)\n"
    fit, u = made(Chain((dynamic(text + "    return s.level", {"rate": 0.3}),)), [0.3]), excitation()
    agrees(Compiled(fit, tmp_path).run(u), fit.simulate(u))


def test_several_channels_have_arrays(tmp_path):
    block, theta = BLOCKS["transfer_matrix"]
    fit, u = made(Chain((block,)), theta), excitation(2)
    compiled = Compiled(fit, tmp_path, u_offset=np.array([1.0, 2.0]))
    assert [p.name for p in compiled.source.parameters[-4:]] == ["u_offset1", "u_offset2", "y_offset1", "y_offset2"]
    agrees(compiled.run(u + np.array([1.0, 2.0])), fit.simulate(u))


@pytest.mark.parametrize(
    ("name", "feeds"),
    [("actuated_joint", False), ("output_error", False), ("state_space", True), ("joint_with_everything", False)],
)
def test_whether_the_output_hangs_on_the_input_of_the_same_sample(name, feeds):
    """Shown by the run: the last input changes the last output, or not."""
    fit, u = structure_fit(name)
    assert export_c.written_source(fit, "m").feeds == feeds
    short = u(300)
    longer = short.copy()
    longer[-1] += 1.0
    assert (fit.simulate(short)[-1] != fit.simulate(longer)[-1]) == feeds


@pytest.mark.parametrize("name", sorted(BLOCKS))
def test_a_block_that_does_not_feed_through_is_said_to_only_if_it_does_not(name):
    block, theta = BLOCKS[name]
    if name == "custom" or block.channels != (1, 1) or type(block).__name__ in ("Channels", "TransferMatrix"):
        pytest.skip("taken apart, or not written")
    code, u = block.c(theta), excitation(N=200)
    fit = made(Chain((block,)), theta)
    for end in range(20, 200, 7):
        longer = u[:end].copy()
        longer[-1] += 1.0
        assert code.feeds or fit.simulate(u[:end])[-1] == fit.simulate(longer)[-1]


AVR_SAYS = """
#include "joint.h"
static const float u[] = {INPUTS};
int main(void)
{
    joint_state s;
    joint_init(&s, &joint_fit);
    clock_start();
    for (unsigned t = 0; t < sizeof u / sizeof u[0]; ++t) {
        union { float y; unsigned long bits; } value;
        value.y = joint_step(&s, &joint_fit, u[t]);
        for (int k = 28; k >= 0; k -= 4) put("0123456789abcdef"[(value.bits >> k) & 15]);
        put(10);
    }
    over();
}
"""


def test_a_joint_runs_on_an_eight_bit_processor(tmp_path):
    """Whose library rounds otherwise: within the tolerance of single precision."""
    if not shutil.which("avr-gcc") or not shutil.which("simavr"):
        pytest.skip("avr-gcc and simavr are in Debian's gcc-avr, avr-libc and simavr")
    tools = runpy.run_path(str(Path(__file__).parents[2] / "scripts" / "footprint.py"))
    fit, u = structure_fit("joint_with_everything")
    u = u(400)
    export_c.write(fit, tmp_path / "joint.c", single=True)
    (tmp_path / "main.c").write_text(
        tools["AVR_MAIN"] + AVR_SAYS.replace("INPUTS", ", ".join(f"{v!r}f" for v in u.tolist()))
    )
    subprocess.run(
        [*tools["AVR"], "-Wno-unused-function", "main.c", "joint.c", "-o", "a.elf", "-lm"], cwd=tmp_path, check=True
    )
    run = ["simavr", "-m", "atmega2560", "-f", "16000000", "a.elf"]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60)
    bits = re.findall(r"\x1b\[32m([0-9a-f]{8})\.", done.stdout + done.stderr)  # its console is green
    y = np.array([int(b, 16) for b in bits], dtype=np.uint32).view(np.float32)
    expected = fit.simulate(u)
    assert len(y) == len(u)
    assert np.abs(y - expected).max() < SINGLE * np.ptp(expected)
