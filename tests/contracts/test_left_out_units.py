"""A unit that a mapping leaves out is that of the header, as without a mapping, and is told."""

import numpy as np
import pytest

import sysid
from sysid import Channel, ChannelMap, InputError
from sysid.channels.guess import guess
from sysid.channels.mapping import Clock
from sysid.channels.mapping_file import write_map

N = 80
K = np.arange(N)
U, Y = np.round(3000 * np.sin(0.1 * K), 1), np.round(40 * np.cos(0.1 * K), 3)


def rig(path, head, stamps):
    rows = (f"{a},{b},{c}\n" for a, b, c in zip(stamps, U, Y, strict=True))
    path.write_text(head + "".join(rows))
    return path


def mapped(clock, into, out):
    return ChannelMap(clock=Clock(column=clock), input=(Channel(column=into),), output=(Channel(column=out),))


HEADS = ("millis,u [mV],y_deg\n", "t_ms,u (mV),y [deg]\n", "timestampMs,u_mV,y (deg)\n", "time,u,y\nms,mV,deg\n")


@pytest.mark.parametrize("head", HEADS)
def test_units_of_the_header_hold_where_the_mapping_names_none(head, tmp_path):
    path = rig(tmp_path / "rig.csv", head, 10 * K)
    made = sysid.read_signals(path, mapped(*head.splitlines()[0].split(",")))
    assert made.Ts == pytest.approx(0.01)
    np.testing.assert_allclose(made.input[0].values, U / 1000, rtol=1e-12)
    np.testing.assert_allclose(made.output[0].values, np.deg2rad(Y), rtol=1e-12)
    assert [signal.unit for signal in made.all] == ["V", "rad"]
    assert [word in " ".join(made.notes) for word in ("in ms, as its", "in mV, as its", "in deg, as its")] == [True] * 3


@pytest.mark.parametrize("head", HEADS)
def test_the_mapping_of_the_guess_gives_the_same_to_the_bit(head, tmp_path):
    path = rig(tmp_path / "rig.csv", head, 10 * K)
    file = write_map(guess(path).mapping, tmp_path / "rig.toml")
    a, b = sysid.read(path), sysid.read(path, map=file)
    assert a.Ts == b.Ts
    np.testing.assert_array_equal(a.u, b.u)
    np.testing.assert_array_equal(a.y, b.y)
    assert (a.u_unit, a.y_unit) == (b.u_unit, b.y_unit) == ("V", "rad")


def test_nanoseconds_since_1970_are_no_seconds(tmp_path):
    path = rig(tmp_path / "rig.csv", "timestamp,u,y\n", 1773136799 * 10**9 + 10**7 * K)
    assert sysid.read_signals(path, mapped("timestamp", "u", "y")).Ts == pytest.approx(0.01, rel=1e-6)


def test_a_clock_without_any_unit_is_in_seconds_and_that_is_told(tmp_path):
    """Slow logs have mappings because the guess asks: they stay what they were."""
    path = rig(tmp_path / "rig.csv", "t,u,y\n", 60 * K)
    made = sysid.read_signals(path, mapped("t", "u", "y"))
    assert made.Ts == 60.0
    assert any(
        "'t' is read in s, steps of 60 s: neither the mapping nor the header names a unit" in n for n in made.notes
    )
    assert sum("names no unit: its numbers stay as they are" in note for note in made.notes) == 2


def test_a_unit_that_is_given_holds_and_the_other_one_is_told(tmp_path):
    path = rig(tmp_path / "rig.csv", "t_ms,u_mV,y_deg\n", 10 * K)
    given = ChannelMap(
        clock=Clock(column="t_ms", unit="ms"),
        input=(Channel(column="u_mV", unit="V"),),
        output=(Channel(column="y_deg", unit=""),),
    )
    made = sysid.read_signals(path, given)
    np.testing.assert_array_equal(made.input[0].values, U)
    np.testing.assert_array_equal(made.output[0].values, Y)
    assert made.notes == ("column 'u_mV' is read in V, as the mapping says; its header names mV",)
    scaled = mapped("t_ms", "u_mV", "y_deg").model_copy(update={"input": (Channel(column="u_mV", scale=0.001),)})
    made = sysid.read_signals(path, scaled)
    np.testing.assert_array_equal(made.input[0].values, 0.001 * U)
    assert any("is scaled by the mapping, and its values name no unit" in note for note in made.notes)


def test_two_units_in_a_header_are_asked_for(tmp_path):
    path = rig(tmp_path / "rig.csv", "t_ms,u_mV [V],y\n", 10 * K)
    with pytest.raises(InputError, match=r"'u_mV \[V\]' has two units, .*; say which as unit of \[\[input\]\]"):
        sysid.read_signals(path, mapped("t_ms", "u_mV [V]", "y"))
    path = rig(tmp_path / "rig.csv", "t_ms [s],u,y\n", 10 * K)
    with pytest.raises(InputError, match=r"has two units, .* unit of \[clock\]"):
        sysid.read_signals(path, mapped("t_ms [s]", "u", "y"))
