"""Exports of oscilloscopes in the layouts of four makers: the plant comes back from each, with its units."""

import numpy as np
import pytest
from plants_in_time import GAIN, TAU, level_at, pole_and_gain, response, steps

from sysid.formats import read_table
from sysid.workflow.record import read_record

TS = 0.02
T = np.arange(600) * TS
U, Y = (of(T, *steps(3, 0.24, 12.0)) for of in (level_at, response))
ROWS = [f"{t - 2.4:.6e},{u:.6e},{y:.12e}" for t, u, y in zip(T, U, Y, strict=True)]
SIGLENT = ["Record Length,Analog:600", f"Sample Interval,Analog:{TS}", "Vertical Units,CH1:V,CH2:V"]
SIGLENT += ["Vertical Scale,CH1:2.00,CH2:5.00", "Horizontal Units,s", "Horizontal Scale,0.1", "Model Number,SDS1104X-E"]
TEKTRONIX = ["Model,MDO3024", "Firmware Version,1.26", "", "Waveform Type,ANALOG,,", "Point Format,Y,,"]
TEKTRONIX += ["Horizontal Units,s,,", f"Sample Interval,{TS},,", "Record Length,600,,", "Vertical Units,V,V,", ",,,"]
LAYOUTS = {
    "Rigol": ["X,CH1,CH2,Start,Increment,", f"Sequence,Volt,Volt,-2.400000e+00,{TS:.6e}"]
    + [f"{k},{u:.6e},{y:.12e},," for k, (u, y) in enumerate(zip(U, Y, strict=True))],
    "Siglent": [*SIGLENT, "Source,CH1,CH2", "Second,Volt,Volt", *ROWS],
    "Siglent, without sources": [*SIGLENT, "Second,Volt,Volt", *ROWS],
    "Tektronix": [*TEKTRONIX, "TIME,CH1,CH2,", *ROWS],
    "Keysight": ["x-axis,1,2", "second,Volt,Volt", *ROWS],
    "Keysight, trailing commas": ["x-axis,1,2,", "second,Volt,Volt,", *(f"{row}," for row in ROWS)],
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_the_plant_comes_back(name, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("\n".join(LAYOUTS[name]) + "\n")
    table = read_table(path)
    u, y = ("1", "2") if name.startswith("Keysight") else ("CH1", "CH2")
    assert table.names == ("time", u, y)
    assert dict(table.units) == ({"time": "s"} if name == "Tektronix" else {"time": "s", u: "V", y: "V"})
    assert table.numbers("time")[:2] == pytest.approx([-2.4, -2.38])
    record = read_record(path, u, y)
    assert (record.data.N, round(record.data.Ts, 9)) == (600, TS)
    found = pole_and_gain(record.data.u[:, 0], record.data.y[:, 0])
    assert found == pytest.approx((np.exp(-TS / TAU), GAIN), abs=1e-6)
    assert any("read as the export of an oscilloscope" in note for note in record.notes)


def test_settings_may_stand_beside_the_numbers(tmp_path):
    """One channel a file, as older ones of Tektronix write it."""
    settings = ["Record Length,6.000000e+02,", f"Sample Interval,{TS:.6e},", "Trigger Point,1.2e+02,", "Source,CH2,"]
    settings += ["Vertical Units,V,", *(",," for _ in range(595))]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(f"{s},{t:.5f},{y:.6e}," for s, t, y in zip(settings, T - 2.4, Y, strict=True)) + "\n")
    table = read_table(path)
    assert (table.names, dict(table.units)) == (("time", "CH2"), {"time": "s", "CH2": "V"})
    np.testing.assert_allclose(table.numbers("CH2"), Y, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("head", ["t,u,y", "t_s,u_V,y_rad", "s,V,rad", "Time,Channel A,Channel B\n(s),(V),(V)"])
def test_other_tables_are_no_exports_of_oscilloscopes(head, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("\n".join([head, *ROWS]))
    notes = read_table(path).notes
    assert not any("oscilloscope" in note for note in notes)
