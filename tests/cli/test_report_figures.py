"""Every figure of the identify report that applies to a model: on the page, on disk, with a caption and with units."""

from dataclasses import replace

import numpy as np
import pytest
from often import by_day
from PIL import Image

import twin
from sysid.base import style
from sysid.report import figures, identify, page
from sysid.structures import ActuatedJoint, HammersteinWiener, NonlinearArx, OutputError
from sysid.workflow.identification import identify_file
from sysid.workflow.saved import Exports
from sysid.workflow.setting import Setting

pytestmark = pytest.mark.pixels

SETTINGS = {
    "hammerstein_wiener": Setting(HammersteinWiener(2, 2, 1), starts=1),
    "output_error": Setting(OutputError(2, 2, 1), starts=1),
    "nlarx": Setting(NonlinearArx(2, 2, 1), starts=1),
    "actuated_joint": Setting(ActuatedJoint(), starts=1),
}
SIGNALS = ("voltage", "angle", "time", "input u", "output y")  # of the record: where they are named, so is their unit


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "thigh.csv"
    twin.Experiment(joint="thigh", excitation="aprbs", duration=100.0, seed=3).run().save(path)
    return path


# A linear model has no figure that one with maps has not.
@pytest.fixture(scope="module", params=by_day(SETTINGS, "hammerstein_wiener", "nlarx", "actuated_joint"))
def report(request, log, tmp_path_factory):
    """Evaluation, page and the folder that it was written into."""
    folder = tmp_path_factory.mktemp("report")
    result = identify_file(log, SETTINGS[request.param])
    made = identify.page(result, Exports())
    page.write(folder, made, {})
    return result.evaluation, made, folder


def applying(evaluation):
    return {name: figure for name, figure in figures.TABLE.items() if figure.applies(evaluation)}


def test_every_figure_that_applies_stands_in_its_section_in_the_order_of_the_table_and_on_disk(report):
    e, made, folder = report
    shown = {section.title: [picture.name for picture in section.pictures] for section in made.sections}
    wanted = applying(e)
    for title, names in shown.items():
        assert names == [name for name, figure in wanted.items() if figure.section == title]
    assert {path.name for path in (folder / "figures").iterdir()} == {f"{name}.png" for name in (*wanted, "answer")}


def test_a_figure_on_disk_is_as_wide_as_the_page_takes_it_and_not_empty(report):
    e, _, folder = report
    for name in applying(e):
        with Image.open(folder / "figures" / f"{name}.png") as image:
            assert image.format == "PNG"
            assert image.width == style.WIDTH * style.DPI
            assert 0.2 < image.height / image.width < 1.0, name
            ink = np.asarray(image.convert("L")) < 240
        assert 0.005 < ink.mean() < 0.8, name  # a wide band fills most of its panel


def test_a_caption_is_a_sentence(report):
    e, made, _ = report
    captions = {picture.name: picture.caption for picture in made.pictures()}
    for name in applying(e):
        caption = captions[name]
        assert caption[0].isupper(), caption
        assert caption.endswith("."), caption
        assert len(caption.split()) > 5, caption
        assert not {"nan", "None", "inf"} & set(caption.replace(",", " ").split()), caption


def test_a_caption_of_a_response_without_a_band_says_so(report, monkeypatch):
    e, _, _ = report
    if not figures.TABLE["bode"].applies(e):
        return
    found = figures.bands(e)

    def beside(upper):
        magnitude = replace(found.frequency.magnitude, upper=upper)
        return replace(found, frequency=replace(found.frequency, magnitude=magnitude))

    bounded, none = (
        beside(2.0 * found.frequency.magnitude.value),
        beside(np.full_like(found.frequency.magnitude.x, np.inf)),
    )
    monkeypatch.setattr(figures, "bands", lambda e: bounded)
    assert "with its 95 % band" in figures.bode_caption(e)
    monkeypatch.setattr(figures, "bands", lambda e: none)
    assert "with its 95 % band" not in figures.bode_caption(e)
    assert "no band" in figures.bode_caption(e)


def test_axes_are_labelled_and_name_their_units_in_degrees(report):
    e, _, _ = report
    for name, figure in applying(e).items():
        axes = np.ravel([figure.draw(e)])
        labels = [label for ax in axes for label in (ax.get_xlabel(), ax.get_ylabel()) if label]
        for ax in axes:
            spec = ax.get_subplotspec()
            assert ax.get_xlabel() or not spec.is_last_row(), name
            named = [text.get_text() for text in ax.get_yticklabels()]
            assert ax.get_ylabel() or not spec.is_first_col() or any(text[:1].isalpha() for text in named), name
        for label in labels:
            assert "[rad" not in label or label == "frequency [rad/s]", f"{name}: {label}"
            assert "[" in label or not any(signal in label for signal in SIGNALS), f"{name}: {label} has no unit"
        assert figure.pure or any(label.endswith("]") for label in labels), f"{name} names no unit"


def test_a_step_from_angle_to_angle_is_said_per_degree(log):
    """A record whose input is an angle too: a gain has the same number in degrees per degree as in rad per rad."""
    e = identify_file(log, SETTINGS["output_error"]).evaluation
    angle = {**vars(e)}
    for part in ("estimation", "validation"):
        data = getattr(e, part)
        angle[part] = type(data)(data.u, data.y, data.Ts, "reference", "angle", "rad", "rad")
    turned = type(e)(**angle)
    caption = figures.TABLE["step-response"].caption(turned)
    said = float(caption.rpartition(" its value is ")[2].split()[0].replace("−", "-"))
    assert caption.endswith("deg/deg.")
    assert said == pytest.approx(e.step.y[-1], rel=5e-3)
    line = figures.TABLE["step-response"].draw(turned)[0].lines[0]
    np.testing.assert_allclose(line.get_ydata(), e.step.y)
