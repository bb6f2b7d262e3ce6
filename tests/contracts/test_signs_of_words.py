"""Words of sign and magnitude, as servo buses send them: found, read, and no other numbers taken for them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import sysid
from sysid.base.errors import InputError
from sysid.channels.mapping import Channel, ChannelMap, Clock
from sysid.data.words import word_of
from sysid.diagnosis.advice import advise
from sysid.workflow.record import read_record
from tests.often import often

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


def levels(rng, values, N=600):
    """Levels (N,) that are held for ten samples."""
    return rng.choice(np.asarray(values, dtype=float), N // 10).repeat(10)


def lag(rng, hold=False):
    """A drawn motion (N,), at most 1, or the levels that cause it."""
    u, y = motion(rng, int(rng.integers(150, 1500)), rng.uniform(0.3, 0.98))
    return u / np.abs(u).max() if hold else y


def counts(rng, half):
    return rng.uniform(0.1, 0.6) * half


WORDS = {  # of a kind with a sign: half of their numbers, and how they are written
    **{f"bit {k}": (2.0**k, lambda y, k=k: word(np.rint(y), k), {"sign_bit": k}) for k in (7, 10, 11, 15)},
    **{f"{b} bits": (2.0 ** (b - 1), lambda y, b=b: np.rint(y) % 2.0**b, {"signed": b}) for b in (8, 16, 32)},
}
SIGNALS = {  # and the least part that is read with its sign; the others are offered
    "motion": (lambda rng, half: counts(rng, half) * lag(rng), 0.9),
    "held levels": (lambda rng, half: counts(rng, half) * lag(rng, hold=True), 0.9),
    "two levels": (lambda rng, half: levels(rng, [-1, 1]) * rng.integers(20, half // 2), 0.0),
    "three levels": (lambda rng, half: levels(rng, [-1, 0, 1]) * rng.integers(20, half // 2), 0.0),
}


@pytest.mark.parametrize("name", SIGNALS)
@pytest.mark.parametrize("kind", WORDS)
def test_signs_are_found(kind, name):
    half, write, reading = WORDS[kind]
    draw, least = SIGNALS[name]
    words = [word_of(write(draw(np.random.default_rng([seed, 1]), half))) for seed in often(200, 30)]
    right = [w for w in words if w is not None and reading.items() <= vars(w).items()]
    assert all(w is None or w in right for w in words)
    assert sum(w.sure for w in right) >= least * len(words)
    assert len(right) >= (0.85 if half > 128.0 or name != "three levels" else 0.0) * len(words)
    if half >= 2.0**15:
        assert all(w.sure for w in right) or least


def test_a_duty_of_two_levels_is_read_with_its_sign():
    found = word_of(levels(np.random.default_rng(0), [400, 33168]))
    assert (found.sign_bit, found.sure) == (15, True)


OTHERS = {
    "a converter": lambda rng: np.rint(512 + 500 * lag(rng)),
    "a converter of levels": lambda rng: np.rint(512 + 500 * lag(rng, hold=True)),
    "12 bits about the middle": lambda rng: np.rint(2048 + rng.uniform(100, 2000) * lag(rng)),
    "an encoder of 16 bits": lambda rng: np.rint(32768 + 30000 * lag(rng)),
    "counts of an encoder": lambda rng: np.rint(rng.uniform(2000, 60000) + 2000 * lag(rng)),
    "two levels of a duty": lambda rng: levels(rng, [0, rng.integers(130, 256)]),
    "two levels of 10 bits": lambda rng: levels(rng, rng.integers(0, 1024, 2)),
    "two levels of 16 bits": lambda rng: levels(rng, rng.integers(0, 65536, 2)),
    "the ends of a converter": lambda rng: levels(rng, [0, 2 ** rng.choice([8, 10, 16]) - rng.integers(0, 2)]),
    "three levels": lambda rng: levels(rng, rng.integers(0, 1024, 3)),
    "levels of a duty": lambda rng: levels(rng, rng.integers(0, 256, 60)),
    "levels of 10 bits": lambda rng: levels(rng, rng.integers(0, 1024, 60)),
    "a magnitude": lambda rng: np.abs(np.rint(700 * lag(rng))),
    "noise with glitches": lambda rng: np.where(rng.random(600) < 0.01, 33000.0, np.rint(np.abs(40 * rng.random(600)))),
    "two bands": lambda rng: np.rint(levels(rng, [100, 1000]) + rng.uniform(0, 100, 600)),
    "any two bands": lambda rng: np.rint(levels(rng, rng.uniform(0, 4e3, 2)) + rng.uniform(3, 200) * rng.random(600)),
    "two levels with noise": lambda rng: np.rint(levels(rng, rng.uniform(30, 1000, 2)) + rng.uniform(-5, 5, 600)),
    "a counter": lambda rng: np.arange(600.0) * rng.integers(1, 9) + rng.integers(0, 300),
    "a counter of 8 bits": lambda rng: np.arange(2000.0) * rng.integers(1, 9) % 256,
    "turns of 12 bits": lambda rng: np.rint(9000 * lag(rng)) % 4096,
    "turns of 16 bits": lambda rng: np.rint(150000 * motion(rng, 900, 0.98)[1]) % 65536,
    "numbers of events": lambda rng: rng.poisson(rng.uniform(50, 3000), 600).astype(float),
    "white numbers": lambda rng: rng.integers(0, rng.integers(150, 5000), 600).astype(float),
}


@pytest.mark.parametrize("name", OTHERS)
def test_no_other_number_is_taken_for_a_word(name):
    words = [word_of(OTHERS[name](np.random.default_rng([seed, 2]))) for seed in often(1000, 40)]
    assert sum(w is not None and w.sure for w in words) <= 1e-3 * len(words)
    assert sum(w is not None for w in words) <= 0.04 * len(words) + 2


def test_a_counter_that_passes_0_without_a_turn_is_one_word():
    """From both ends of the word the numbers go on; beyond half of it they would not, and are no such word."""
    rng = np.random.default_rng(3)
    y = np.rint(20 * lag(rng))
    assert word_of(y % 65536).signed == 16
    assert word_of((y + 4 * np.arange(len(y)) * 65536 / len(y)).astype(int) % 65536.0) is None


@pytest.mark.parametrize("kind", ["signed = 16", "sign_bit = 15"])
@pytest.mark.parametrize("hidden", ["input", "output", "both"])
def test_words_of_either_channel_give_the_right_pole_and_gain(kind, hidden, tmp_path):
    """As they come, and by the entry of the mapping that the warning about plain numbers names."""
    rng = np.random.default_rng(8)
    u, y = levels(rng, [-400, 400]), np.zeros(600)
    for k in range(1, 600):
        y[k] = 0.82 * y[k - 1] + 0.18 * 0.5 * u[k - 1]
    write = (lambda x: word(np.rint(x), 15)) if "bit" in kind else (lambda x: np.rint(x) % 65536)
    u_file, y_file = (write(x) if hidden in (role, "both") else np.rint(x) for x, role in ((u, "input"), (y, "output")))
    path = tmp_path / "a.csv"
    path.write_text("t_s,u,y\n" + "".join(f"{0.01 * k:.2f},{u_file[k]:g},{y_file[k]:g}\n" for k in range(600)))
    record = read_record(path)
    np.testing.assert_array_equal(record.data.y[:, 0], np.rint(y))
    fit = sysid.fit(sysid.structures.output_error(nb=1, nf=1, nk=1), record.data, starts=1)
    f1, b0 = (fit.theta[fit.model.names.index(name)] for name in ("linear.f1", "linear.b0"))
    assert (-f1, b0 / (1 + f1)) == (pytest.approx(0.82, abs=0.005), pytest.approx(0.5, abs=0.005))
    plain = ChannelMap(clock=Clock(column="t_s"), input=(Channel(column="u"),), output=(Channel(column="y"),))
    warnings = [a for a in advise(read_record(path, mapping=plain).data) if a.topic == "wraps"]
    assert len(warnings) == (2 if hidden == "both" else 1)
    for warning in warnings:
        entry, table = re.search(r"set (\w+ = \d+) in its \[\[(\w+)\]\]", warning.action).groups()
        assert entry == kind
        (channel,) = getattr(plain, table)
        name, _, number = entry.partition(" = ")
        plain = plain.model_copy(update={table: (channel.model_copy(update={name: int(number)}),)})
    np.testing.assert_array_equal(read_record(path, mapping=plain).data.u, record.data.u)
    np.testing.assert_array_equal(read_record(path, mapping=plain).data.y, record.data.y)


def test_what_may_be_a_word_is_offered_and_not_read(tmp_path):
    u = levels(np.random.default_rng(8), [-400, 400])
    path = tmp_path / "a.csv"
    path.write_text("t_s,u,y\n" + "".join(f"{0.01 * k:.2f},{v:g},{k % 7}\n" for k, v in enumerate(word(u, 10))))
    record = read_record(path)
    assert record.data.u.max() == 1424.0
    (note,) = (note for note in record.notes if "may hold" in note)
    entry = re.search(r"set (sign_bit = 10) of \[\[input\]\]", note)[1]
    text = f'[clock]\ncolumn = "t_s"\n[[input]]\ncolumn = "u"\n{entry}\n[[output]]\ncolumn = "y"\n'
    (tmp_path / "m.toml").write_text(text)
    np.testing.assert_array_equal(read_record(path, mapping=tmp_path / "m.toml").data.u[:, 0], u)


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
