"""A figure of ours is the same whatever matplotlib is set to, and the user's own settings stay as they were."""

import os
import re
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

import sysid
import twin
from sysid import plots
from sysid.base import style
from sysid.base.looks import for_a_person

pytestmark = pytest.mark.pixels

ODD = {
    "text.usetex": True,
    "font.family": ["NoSuchFont"],
    "lines.linewidth": 9.0,
    "axes.facecolor": "black",
    "savefig.bbox": "tight",
    "savefig.dpi": 30,
    "xtick.bottom": False,
    "path.sketch": (1.0, 100.0, 2.0),
    "figure.subplot.left": 0.4,
    "image.cmap": "gray",
    "axes.formatter.use_locale": True,
}


def drawn():
    t = np.arange(60)
    return plots.record(sysid.IOData(np.sin(t), np.cos(t), Ts=0.1))


def test_a_figure_has_the_same_bytes_under_odd_settings_which_stay():
    plain = style.png(drawn())
    with mpl.rc_context(ODD):
        before = dict(mpl.rcParams)
        assert style.png(drawn()) == plain
        assert dict(mpl.rcParams) == before


def test_a_figure_at_a_prompt_is_a_picture_under_odd_settings():
    with for_a_person():
        plain = drawn()[0].figure._repr_png_()
        with mpl.rc_context(ODD):
            assert drawn()[0].figure._repr_png_() == plain


def test_an_image_is_not_turned_over():
    rgb = np.zeros((4, 3, 3), dtype=np.uint8)
    rgb[0] = 255
    plain = style.image_png(rgb)
    with mpl.rc_context({"image.origin": "lower"}):
        assert style.image_png(rgb) == plain


@pytest.mark.parametrize("name", ["角度", "$\\frac{", "a_{", "x" * 400, "\U0001f600", "%{}\\", "a\nb", "é\u0301"])
def test_any_name_of_a_channel_is_drawn(name):
    """Warnings are errors here: letters that no font has, formulas that are none, names longer than the figure."""

    @style.styled
    def one():
        (axes,) = style.panels(None)
        style.line(axes, np.arange(3), np.arange(3), label=name)
        axes.set(xlabel=name, ylabel=name, title=name)
        style.legend(axes)
        return axes

    assert len(style.png(one())) > 3000


def test_a_name_that_begins_with_an_underscore_stays_in_the_legend():
    @style.styled
    def two():
        (axes,) = style.panels(None)
        style.line(axes, np.arange(3), np.arange(3), label="_angle")
        axes.plot([0, 1], [0, 1])
        style.legend(axes)
        return axes

    assert [text.get_text().strip("\u200b") for text in two().get_legend().get_texts()] == ["_angle"]


CODE = """
import hashlib, numpy as np, sys
from sysid.base import style
@style.styled
def draw():
    (axes,) = style.panels(None)
    style.line(axes, np.arange(9), np.arange(9) ** 2, label="y")
    style.legend(axes)
    return axes
print(hashlib.sha256(style.png(draw())).hexdigest())
"""


@pytest.mark.parametrize("content", [b"\xff\xfeodd", b"text.usetex: True\nfont.size: 30\nno colon\n", None])
def test_a_file_of_settings_that_cannot_be_read_costs_no_figure(content, tmp_path):
    variables = {**os.environ, "MPLBACKEND": "nowhere"}
    if content is None:
        variables["MATPLOTLIBRC"] = "/dev/zero"
    else:
        (tmp_path / "matplotlibrc").write_bytes(content)
    done = subprocess.run(
        [sys.executable, "-c", CODE], cwd=tmp_path, env=variables, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr[-500:]
    scope: dict = {}
    exec(CODE.replace("print(", "found = ("), scope)
    assert done.stdout.strip() == scope["found"]


def test_control_which_imports_matplotlib_comes_after_it(tmp_path):
    """An odd MPLBACKEND ends the import of matplotlib; `load` imports it without."""
    first, late = re.compile(r"^ +load\(\).*\n +import control$", re.MULTILINE), r"^ *import control\b"
    for package in (sysid, twin):
        for path in Path(package.__path__[0]).rglob("*.py"):
            text = re.sub(r"'''.*?'''", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)  # a program to write
            assert len(first.findall(text)) == len(re.findall(late, text, re.MULTILINE)), path
    code = "from sysid.base.looks import load; load(); import control; print(len(control.tf([1], [1, 2]).poles()))"
    variables = {**os.environ, "MPLBACKEND": "nowhere"}
    done = subprocess.run([sys.executable, "-c", code], env=variables, capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "1", done.stderr[-500:]
