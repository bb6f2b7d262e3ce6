"""Text from files acts on no reader: every way out escapes it and cuts it, and what is data reads back the same."""

import io
import json
import sys
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from exported import structure_fit
from matplotlib.text import Text
from texts import HOSTILE, LONG, acting

import sysid
from sysid.base.errors import InputError, printable, readable
from sysid.base.files import write_text
from sysid.channels.mapping import Channel, ChannelMap
from sysid.channels.mapping_file import map_text, read_map
from sysid.drawing.axes import draw
from sysid.drawing.figure import Axis, Bars, Figure, Line, Panel, Points, Rule, Span
from sysid.drawing.plotly import plotly
from sysid.estimation.codec import lines
from sysid.estimation.origin import Origin
from sysid.export import c, fmu, matlab, modelica, onnx, python
from sysid.report.page import Grid, Listing, Page, Picture, Section, packed, to_json
from twin.app.entries import Data, Finding, Model, Prepare, Setting, Study
from twin.cli import console, environment, main

SHOWN = r"a\x1b[31m\x07\rb\x08\x7f\u202ec\u2066\u200b\u2028\x9b1md"


@pytest.fixture(scope="module")
def fit():
    """A fit whose every text is hostile."""
    fit, _ = structure_fit("output_error")
    return replace(fit, origin=Origin(*[f"x{HOSTILE} */ int f;"] * 4, 300, 90.0), warnings=(HOSTILE,))


@pytest.fixture
def log(tmp_path):
    """A log whose every name is hostile."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, 30), 5)
    columns = {f"time_s{HOSTILE}": np.arange(150) * 0.1, f"volts{HOSTILE}": u, f"angle{HOSTILE} [{HOSTILE}]": 0.1 * u}
    pl.DataFrame(columns).write_parquet(tmp_path / "log.parquet")
    return tmp_path / "log.parquet"


def texts(value):
    """All texts and names of a document."""
    if isinstance(value, dict):
        return [text for key, entry in value.items() for text in [key, *texts(entry)]]
    if isinstance(value, list | tuple):
        return [text for entry in value for text in texts(entry)]
    return [value] if isinstance(value, str) else []


@pytest.mark.parametrize("shown", [printable, readable])
def test_what_acts_is_written_as_its_number(shown):
    assert shown(HOSTILE) == SHOWN
    assert shown("Drehzahl ω [°/s]\t角度 é\n") == "Drehzahl ω [°/s]\t角度 é\n"
    assert shown(shown(HOSTILE)) == SHOWN  # two doors in a row are one


def test_what_is_long_is_cut_where_it_is_shown():
    assert readable(LONG) == f"{'a' * 200}...{'a' * 200}"
    assert len(readable("name " * 2000)) < 2100
    assert printable(LONG) == LONG


def terminal(log, fit, capsys):
    assert main(["info", str(log)]) in (0, 1)
    return "".join(capsys.readouterr())


def error(log, fit, capsys):
    assert main(["info", str(log), "--input", HOSTILE]) == 2
    return "".join(capsys.readouterr())


def table(log, fit, capsys):
    with environment.streams():
        console.show(Grid([HOSTILE, LONG], [[HOSTILE, LONG]], HOSTILE))
    return capsys.readouterr().out


def foreign(log, fit, capsys):
    """A library, or a method of others, prints what it likes."""
    with environment.streams():
        print(HOSTILE, LONG)
        sys.stderr.writelines([HOSTILE])
    return "".join(capsys.readouterr())


def page(log, fit, capsys):
    picture = Picture("name", b"", HOSTILE + LONG, plotly(figure()))
    grids = [Grid([HOSTILE, "b"], [[HOSTILE, LONG], ["a", HOSTILE]], HOSTILE, note=HOSTILE, sortable=k) for k in (0, 1)]
    section = Section(HOSTILE, [HOSTILE, LONG], grids, [picture], grids, [Listing(HOSTILE, HOSTILE)])
    return Page(HOSTILE, HOSTILE, [HOSTILE, LONG], [section], {HOSTILE: HOSTILE}).html().partition("</head>")[2]


def figure():
    line = [Line(np.arange(3.0), np.arange(3.0), HOSTILE + LONG), Points(np.arange(2.0), np.arange(2.0), HOSTILE)]
    axis = Axis(HOSTILE, HOSTILE, HOSTILE)
    names = Panel([Bars([1.0], HOSTILE, notes=[HOSTILE], texts=[HOSTILE])], Axis(names=[HOSTILE]), title=HOSTILE)
    return Figure([Panel(line, axis, axis, HOSTILE, note=HOSTILE), names], marks=[Rule(1.0, label=HOSTILE), Span(0, 1)])


def zoomable(log, fit, capsys):
    return "\n".join(texts(plotly(figure())))


def picture(log, fit, capsys):
    sheet = draw(figure())[0].figure
    return "\n".join(text.get_text() for text in sheet.findobj(Text)).replace(LONG[:300], "")


def stranger_of_a_figure(log, fit, capsys):
    return "\n".join(texts(packed({"data": [{"name": HOSTILE, HOSTILE: 1}]})))


def file(log, fit, capsys):
    return write_text(log.parent / "x.txt", HOSTILE).read_text() + SHOWN


def summary(log, fit, capsys):
    assert json.loads(to_json({HOSTILE: HOSTILE})) == {HOSTILE: HOSTILE}
    return to_json({HOSTILE: HOSTILE})


def model(log, fit, capsys):
    assert json.loads(lines({HOSTILE: [HOSTILE]})) == {HOSTILE: [HOSTILE]}
    return fit.save(log.parent / "model.json").read_text()


def mapping(log, fit, capsys):
    channels = {"input": (Channel(column=HOSTILE + "\U000e0001", name=HOSTILE),), "output": (Channel(column="y"),)}
    text = map_text(ChannelMap(**channels), HOSTILE, {"input.column": HOSTILE})
    (log.parent / "map.toml").write_text(text)
    assert read_map(log.parent / "map.toml").input[0].column == HOSTILE + "\U000e0001"
    return text


def c_source(log, fit, capsys):
    made = c.written_source(fit, "model", False)
    assert made.header.count("/*") == made.header.count("*/")  # no unit ends the comment in which it stands
    return made.header + made.text


def python_source(log, fit, capsys):
    return python.source(fit)


def matlab_source(log, fit, capsys):
    return matlab.source(fit)


def modelica_source(log, fit, capsys):
    return modelica.source(fit)


def onnx_texts(log, fit, capsys):
    pytest.importorskip("onnx", reason="onnx is in the onnx extra")
    made = onnx.model(fit)
    return "\n".join([made.doc_string, *(p.value for p in made.metadata_props)])


def fmu_description(log, fit, capsys):
    import zipfile

    fmu.write(fit, log.parent / "model.fmu")
    with zipfile.ZipFile(log.parent / "model.fmu") as archive:
        return "".join(archive.read(n).decode() for n in archive.namelist() if n.endswith((".xml", ".h", ".c")))


def session(log, fit, capsys):
    said = Finding(sentence=HOSTILE, action=HOSTILE, severity="note")
    board = {"fit_estimation": 1.0, "fit_validation": None, "d": 3, "N": 20, "seconds": 1.0, "converged": True}
    entries = [
        Data(name=HOSTILE, suffix=".csv", notes=[HOSTILE], problem=HOSTILE, advice=[said], columns=[HOSTILE]),
        Model(name=HOSTILE, data="d1", prepare=Prepare(), setting=Setting(), notes=[HOSTILE], **board),
        Study.model_validate_json(
            json.dumps({"kind": "compare", "data": "d1", "joint": "thigh", "sentences": [HOSTILE]})
        ),
    ]
    assert entries[0].columns == (HOSTILE,)  # the name of the file's column; the page shows it escaped
    return "\n".join(texts([entry.model_dump(exclude={"columns"}) for entry in entries]))


def prompt(log, fit, capsys):
    data = sysid.IOData(np.arange(9.0), np.arange(9.0), 0.1, HOSTILE, LONG, HOSTILE, HOSTILE)
    return "\n".join([repr(data), str(data), data._repr_html_(), str(fit), fit._repr_html_()])


SINKS = [
    terminal, error, table, foreign, page, zoomable, picture, stranger_of_a_figure, file, summary, model, mapping,
    c_source, python_source, matlab_source, modelica_source, onnx_texts, fmu_description, session, prompt,
]  # fmt: skip
DATA = (summary, model, mapping, stranger_of_a_figure, picture)  # keep what is long, or cut it elsewhere


@pytest.mark.parametrize("sink", SINKS, ids=lambda sink: sink.__name__)
def test_no_way_out_is_open(sink, log, fit, capsys):
    out = sink(log, fit, capsys)
    assert not acting(out.replace("\r\n", "\n") if sink is fmu_description else out)
    assert sink in DATA or "a" * 600 not in out
    if sink not in (python_source, matlab_source):  # which hold no text of a file
        assert "x1b[31m" in out or "u001b[31m" in out or "U0000001b[31m" in out


def test_a_figure_that_zooms_shows_a_name_and_obeys_none():
    """plotly takes <b>, links and %{x} in a text for its own."""
    name = '<a href="http://x">%{x}</a>&'
    panel = Panel([Line(np.arange(3.0), np.arange(3.0), name)], Axis(name, name, name))
    made = plotly(Figure([panel]))
    assert made["data"][0]["name"] == '&lt;a href="http://x"&gt;&#37;{x}&lt;/a&gt;&amp;'
    assert not any("<a" in text or "%{x}" in text for text in texts(made))


def test_a_bar_shows_the_name_of_a_file_as_it_is(monkeypatch):
    class Screen(io.StringIO):
        def isatty(self):
            return True

    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    with console.progress(1) as step:
        step(f"reading [/x]{HOSTILE}")
    assert r"[/x]a\x1b[31m\x07\rb" in screen.getvalue()


@pytest.mark.parametrize("place", ["warnings", "search", "key"])
def test_half_a_letter_in_a_saved_model_is_refused_at_load(place, fit, tmp_path):
    path = fit.save(tmp_path / "model.json")
    document = json.loads(path.read_text())
    document |= {"key": {"x\ud800": 1}, "warnings": {"warnings": ["it\ud800 is"]}, "search": {"search": "l\ud800"}}[
        place
    ]
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"holds \\ud800, half of a letter"):
        sysid.load(path)


def test_the_advised_correction_of_half_a_letter_loads(fit, tmp_path):
    path = fit.save(tmp_path / "model.json")
    path.write_text(path.read_text().replace('u_name": "', 'u_name": "\\ud83e\\uddbf\\udc00'))
    with pytest.raises(InputError, match=r"near .*🦿"):
        sysid.load(path)
    path.write_text(path.read_text().replace("\\udc00", ""))  # a pair is a letter
    assert sysid.load(path).origin.u_name.startswith("🦿")
    assert sysid.load(sysid.load(path).save(path)).origin == sysid.load(path).origin
