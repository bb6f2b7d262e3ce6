"""Methods of fits and logs with values of every odd kind: a result or one sentence, no other error, no warning."""

import os
from collections.abc import Iterator

import numpy as np
import pytest
import shown

import sysid
import twin
from sysid.base.errors import InputError

U, Y = np.arange(200.0) % 7.0, np.arange(200.0) % 5.0


def values() -> Iterator[object]:
    yield from (None, True, 0, -1, 1.5, float("nan"), 10**60, "", "x", b"x", ..., slice(1, 3), object(), int)
    yield from ([], [1], (1, 2), {}, set(), iter([1]), np.zeros(3), np.zeros((0, 3)), np.array([1j]), np.array([None]))
    yield from (np.int8(3), np.uint8(255), np.float32(0.5), np.timedelta64(1, "s"), np.array([1], "timedelta64[s]"))


CALLS = {
    "report of": lambda v: shown.fit().report(v),
    "report on": lambda v: shown.fit().report("page.html", v),
    "report checked on": lambda v: shown.linear().report("page.html", shown.data(), v),
    "report of a network": lambda v: shown.network().report(v),
    "plot": lambda v: shown.fit().plot(v),
    "plot what": lambda v: shown.fit().plot(shown.data(), v),
    "plot at": lambda v: shown.fit().plot(shown.data(), "bode", v),
    "plot of a network": lambda v: shown.network().plot(v),
    "curve": lambda v: shown.fit().curve("input", v),
    "curve of": lambda v: shown.fit().curve(v, U),
    "refine": lambda v: shown.linear().refine(v),
    "noise model": lambda v: shown.fit().noise_model(v),
    "modes": lambda v: shown.fit().modes(v),
    "horizon": lambda v: shown.fit().predict(shown.data(), v),
    "horizon of a network": lambda v: shown.network().predict(shown.data(), v),
    "compare": lambda v: sysid.compare(shown.data(), v),
    "compare two": lambda v: sysid.compare(shown.data(), shown.fit(), v),
    "labels": lambda v: sysid.compare(shown.data(), shown.fit(), labels=v),
    "huber": lambda v: sysid.Objective(huber_threshold=v),
    "space": lambda v: v is None or sysid.select(shown.data(), v, seconds=1.0),
    "lengths": lambda v: sysid.IOData(U, Y, 0.1, lengths=v),
    "log u": lambda v: twin.Log(v, Y, 0.1).N,
    "log y": lambda v: twin.Log(U, v, 0.1).io(),
    "log Ts": lambda v: twin.Log(U, Y, v).t,
    "log y_true": lambda v: twin.Log(U, Y, 0.1, v),
    "log joint": lambda v: twin.Log(U, Y, 0.1, None, v).save("log.csv"),
    "log meta": lambda v: twin.Log(U, Y, 0.1, None, "", v).mode,
    "log file": lambda v: twin.Log(U, Y, 0.1).save(v),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_value_of_another_kind_is_a_sentence_or_serves(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused = []
    for value in values():
        try:
            CALLS[name](value)
        except InputError as error:
            refused.append(str(error))
    assert refused
    assert not any("\n" in sentence for sentence in refused)


def test_a_small_integer_of_numpy_is_a_horizon_like_any_other():
    for fit in (shown.fit(), shown.network()):
        np.testing.assert_array_equal(fit.predict(shown.data(), np.int8(3)), fit.predict(shown.data(), 3))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_is_no_journal(tmp_path):
    """Before, the search waited for a reader without end."""
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="pipe"):
        sysid.select(shown.data(), seconds=5.0, journal=tmp_path / "pipe")
