"""Words of sign and magnitude, as servo buses send them: found, read, and no other numbers taken for them."""

import json
from pathlib import Path

import numpy as np
import pytest

import sysid
from sysid.base.errors import InputError
from sysid.channels.sign import sign_bit_of
from sysid.workflow.record import read_record

CASES = Path(__file__).parent / "cases"


def motion(rng, N, a):
    """The response (N,) of a first-order lag to drawn levels, at most 1."""
    u = np.repeat(rng.normal(size=N // 10 + 1), 10)[:N]
    y = np.zeros(N)
    for k in range(1, N):
        y[k] = a * y[k - 1] + (1 - a) * u[k - 1]
    return u, y / np.abs(y).max()


def word(y, bit):
    return np.where(y < 0, 2**bit - y, y)


def test_the_speed_of_a_servo_is_read_with_its_sign():
    record = read_record(CASES / "sign_bit15.csv", input="voltage", output="Present_Velocity")
    assert (record.data.y.min(), record.data.y.max()) == (-440.0, 439.0)
    assert any("bit 15" in note and "sign_bit = 0" in note for note in record.notes)
    fit = sysid.fit(sysid.structures.output_error(nb=1, nf=1, nk=1), record.data, starts=1)
    f1, b0 = (fit.theta[fit.model.names.index(name)] for name in ("linear.f1", "linear.b0"))
    assert -f1 == pytest.approx(0.82, abs=0.005)
    assert b0 / (1 + f1) == pytest.approx(80.0, abs=1.0)


@pytest.mark.parametrize("bit", [7, 10, 11, 15])
def test_signs_are_found(bit):
    found = 0
    for seed in range(100):
        rng = np.random.default_rng([seed, bit])
        N, a = int(rng.integers(100, 1500)), rng.uniform(0.3, 0.98)
        found += sign_bit_of(word(np.rint(motion(rng, N, a)[1] * rng.uniform(0.1, 0.6) * 2**bit), bit)) == bit
    assert found >= 97


OTHERS = {
    "a converter": lambda rng, y: np.rint(512 + 500 * y),
    "an encoder of 16 bits": lambda rng, y: np.rint(32768 + 30000 * y),
    "two levels of a duty": lambda rng, y: rng.choice([0.0, rng.integers(130, 255)], 60).repeat(10),
    "levels of a duty": lambda rng, y: rng.integers(0, 256, 60).repeat(10).astype(float),
    "a magnitude": lambda rng, y: np.abs(np.rint(700 * y)),
    "noise with glitches": lambda rng, y: np.where(rng.random(600) < 0.01, 33000.0, np.rint(np.abs(40 * y))),
    "two's complement": lambda rng, y: np.rint(440 * y) % 65536,
}


@pytest.mark.parametrize("name", OTHERS)
def test_no_other_number_is_taken_for_a_word(name):
    false = sum(
        sign_bit_of(OTHERS[name](rng, motion(rng, 600, 0.9)[1])) > 0 for rng in map(np.random.default_rng, range(100))
    )
    assert false <= 1


def test_the_mapping_has_the_last_word(tmp_path):
    (tmp_path / "m.toml").write_text(
        '[clock]\ncolumn = "t_ms"\nunit = "ms"\n[[input]]\ncolumn = "voltage"\n'
        '[[output]]\ncolumn = "Present_Velocity"\nsign_bit = 0\n'
    )
    path = CASES / "sign_bit15.csv"
    assert read_record(path, mapping=tmp_path / "m.toml").data.y.max() == 33208.0
    text = (tmp_path / "m.toml").read_text()
    (tmp_path / "m.toml").write_text(text.replace("sign_bit = 0", "sign_bit = 10"))
    with pytest.raises(InputError, match=r"found 32769 in a word whose sign is bit 10; set sign_bit"):
        read_record(path, mapping=tmp_path / "m.toml")
    (tmp_path / "m.toml").write_text(text.replace("sign_bit = 0", "sign_bit = 15\nsigned = 16"))
    with pytest.raises(InputError, match="give one of the two"):
        read_record(path, mapping=tmp_path / "m.toml")


@pytest.mark.parametrize("layout", ["json", "semicolons", "input too"])
def test_siblings_in_other_files(layout, tmp_path):
    """Bit 10 of a load, bit 11 of a position beside a goal with the same bit."""
    u, y = motion(np.random.default_rng(5), 400, 0.8)
    u = np.rint(300 * u / np.abs(u).max())
    counts = np.rint(900 * y)
    t = 5 * np.arange(400)
    goal = word(u, 11) if layout == "input too" else u
    path = tmp_path / ("a.json" if layout == "json" else "a.csv")
    if layout == "json":
        path.write_text(json.dumps({"t_ms": t.tolist(), "pwm": goal.tolist(), "load": word(counts, 10).tolist()}))
    else:
        rows = zip(t, goal, word(counts, 11), strict=True)
        path.write_text("t_ms;pwm;position\n" + "".join(f"{a};{b:g};{c:g}\n" for a, b, c in rows))
    output = "load" if layout == "json" else "position"
    data = read_record(path, input="pwm", output=output).data
    np.testing.assert_array_equal(data.y[:, 0], counts)
    if layout == "input too":
        np.testing.assert_array_equal(data.u[:, 0], u)
