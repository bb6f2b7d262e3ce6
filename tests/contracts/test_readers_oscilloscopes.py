"""Exports of oscilloscopes in the layouts of seven makers: the plant comes back from each, with its units."""

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
MSO = ["Model,MSO44", "Label,,", "Waveform Type,ANALOG,", "Horizontal Units,s,", f"Sample Interval,{TS:.8e},"]
MSO += ["Record Length,600,", "Zero Index,120.0,", "Vertical Units,V,V", ",,", "Labels,,", "TIME,CH1,CH2"]
LECROY = ["LECROYWS3034,10081,Waveform", "Segments,1,SegmentSize,600", "Segment,TrigTime,TimeSinceSegment1"]
LECROY += ["#1,23-Mar-2022 02:21:36,0                 ", "Time,Ampl1,Ampl2"]
YOKOGAWA = ['"Header Size","15"', '"Model Name","DLM3024"', '"Comment",""', '"BlockNumber","1"']
YOKOGAWA += ['"TraceName","CH1","CH2"', '"BlockSize","600","600"', '"VUnit","V","V"', '"SampleRate","50","50"']
YOKOGAWA += [
    f'"HResolution","{TS}","{TS}"',
    '"HOffset","-2.4","-2.4"',
    '"HUnit","s","s"',
    '"DisplayBlockSize","600","600"',
]
YOKOGAWA += ['"DisplayPointNo.","1","1"', '"Date","2022/03/23","2022/03/23"', '"Time","02:21:36.0","02:21:36.0"']
INFINIIUM = ["Revision:,0", "Type:,raw,raw", "Start:,0,0", "Points:,600,600", "Count:,1,1", "XDispRange:,12.0,12.0"]
INFINIIUM += ["XDispOrg:,-2.4,-2.4", f"XInc:,{TS:.15e},{TS:.15e}", "XOrg:,-2.4,-2.4", "XUnits:,Second,Second"]
INFINIIUM += ["YDispRange:,8,8", "YDispOrg:,0,0", "YInc:,1e-9,1e-9", "YOrg:,0,0", "YUnits:,Volt,Volt"]
INFINIIUM += ["Frame:,DSO90404A:MY0", "Date:,27 DEC 1996", "Time:,01:00:00:00", "Max bandwidth:,4e9,4e9", "Data:"]
TRACES = [f"{u:.6e},{y:.12e}" for u, y in zip(U, Y, strict=True)]
LAYOUTS = {
    "Tektronix MSO": [*MSO, *ROWS],
    "LeCroy": [*LECROY, *ROWS],
    "Yokogawa": [*YOKOGAWA, *TRACES],
    "Infiniium": [*INFINIIUM, *TRACES],
    "Infiniium, one time": [*INFINIIUM, *ROWS],
    "Infiniium, no colons": [*(line.replace(":", "") for line in INFINIIUM[:-2]), "Data", *TRACES],
    "Infiniium, times": [
        *INFINIIUM,
        *(f"{r.split(',')[0]},{r.split(',')[1]},{r.split(',')[0]},{r.split(',')[2]}" for r in ROWS),
    ],
    "Yokogawa, values behind the settings": [*YOKOGAWA, "", *(f",{row}" for row in TRACES)],
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
    u, y = {"Keysight": ("1", "2"), "LeCroy": ("Ampl1", "Ampl2")}.get(name.split(",")[0], ("CH1", "CH2"))
    times = ("time", u, "time 2", y) if name == "Infiniium, times" else ("time", u, y)
    assert table.names == times
    units = {"time": "s"} if name == "LeCroy" else {"time": "s", u: "V", y: "V"}
    assert dict(table.units) == (units | {"time 2": "s"} if "time 2" in times else units)
    assert table.numbers("time")[:2] == pytest.approx([-2.4, -2.38])
    record = read_record(path, u, y)
    assert (record.data.N, round(record.data.Ts, 9)) == (600, TS)
    found = pole_and_gain(record.data.u[:, 0], record.data.y[:, 0])
    assert found == pytest.approx((np.exp(-TS / TAU), GAIN), abs=1e-6)
    assert any("read as an instrument exports it" in note for note in record.notes)


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


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e3)])
def test_units_below_the_names_of_a_data_logger_are_those_of_its_columns(unit, factor, tmp_path):
    """Settings in quotes, a blank line, names, units, a blank line, as AiM and MoTeC write them."""
    rows = [f"{k * 0.02 * factor:g},{1000 * (k % 7)},{60 * k}" for k in range(50)]
    head = ['"Format","AiM CSV File"', '"Sample Rate","50"', "", '"Time","Drive","Wheel"', f'"{unit}","mV","rpm"', ""]
    (tmp_path / "a.csv").write_text("\n".join([*head, *rows, ""]))
    record = read_record(tmp_path / "a.csv", input="Drive", output="Wheel").data
    assert record.Ts == pytest.approx(0.02)
    np.testing.assert_allclose(record.u[:, 0], np.arange(50) % 7)
    np.testing.assert_allclose(record.y[:, 0], 2.0 * np.pi * np.arange(50))
