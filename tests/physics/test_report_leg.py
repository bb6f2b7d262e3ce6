"""The leg of a report in three dimensions: its points are those of the closed form, its frames those of the record."""

import numpy as np
import pytest
from plotly import graph_objects

import twin
from twin.parameters import JOINTS
from twin.plant.leg import robot
from twin.report import leg
from twin.robot.kinematics import body
from twin.view.stills import mid_stroke

pytestmark = pytest.mark.pixels


@pytest.fixture(scope="module")
def lengths():
    parameters = twin.Parameters()
    return body(parameters, robot(parameters)).leg


def test_the_foot_is_where_the_closed_form_puts_it(lengths):
    rng = np.random.default_rng(0)
    angles = lengths.lower + (lengths.upper - lengths.lower) * rng.uniform(size=(7, 3))
    found = leg.poses(dict(zip(JOINTS, angles.T, strict=True))).links
    out, aside, up = np.moveaxis(lengths.foot(angles), -1, 0)
    # The leg's outward is the body's left, and its left is the body's rear.
    np.testing.assert_allclose(found[:, 3], np.column_stack([-aside, out, up]), atol=1e-12)
    sizes = np.linalg.norm(np.diff(found, axis=1), axis=2)
    np.testing.assert_allclose(sizes, np.tile([lengths.hip, lengths.thigh, lengths.shank], (7, 1)))


def test_joints_without_a_record_are_at_mid_stroke(lengths):
    parameters = twin.Parameters()
    model = robot(parameters)
    rest = [mid_stroke(model, parameters)[model.joint(f"{joint}_00").qposadr[0]] for joint in JOINTS]
    (found,) = leg.poses({"thigh": np.array([0.2])}).links
    out, aside, up = lengths.foot(np.array([rest[0], 0.2, rest[2]]))
    np.testing.assert_allclose(found[3], [-aside, out, up], atol=1e-12)


def test_a_leg_in_one_plane_is_not_drawn_from_above_as_a_line():
    swing = 0.3 * np.sin(np.arange(50) * 0.2)
    thigh, shoulder = (leg.draw({"log": leg.poses({joint: swing})}) for joint in ("thigh", "shoulder"))
    assert [ax.get_title("left") for ax in thigh] == ["from the side"]
    assert [ax.get_title("left") for ax in shoulder] == ["(a) from the side", "(b) from above"]


def test_a_frame_stands_for_its_moment_and_the_slider_says_which():
    t = np.arange(500) * 0.02
    log, model = 0.3 * np.sin(t), 0.3 * np.sin(t) + 0.1
    log[200:250] = np.nan  # a gap: the leg moves straight over it
    made = leg.picture("leg", t, {"log": {"thigh": log}, "twin": {"thigh": model}})
    figure = made.zoom
    graph_objects.Figure(figure)
    assert len(figure["frames"]) == leg.FRAMES
    (slider,) = figure["layout"]["sliders"]
    assert len(slider["steps"]) == leg.FRAMES
    k = 30
    at = round(k * 499 / 100)
    label = slider["steps"][k]["label"]
    assert label == f"{t[at]:.4g} s; log: thigh {np.degrees(log[at]):.1f}°; twin: thigh {np.degrees(model[at]):.1f}°"
    assert slider["steps"][k]["args"][0] == [figure["frames"][k]["name"]]
    drawn = {trace["name"]: trace for trace in figure["frames"][k]["data"]}
    pose = leg.poses({"thigh": model[at : at + 1]}).links[0]
    np.testing.assert_allclose(np.column_stack([drawn["twin"][axis] for axis in "xyz"]), pose, atol=1e-4)
    names = [trace["name"] for trace in figure["data"]]
    assert [names[n] for n in figure["frames"][k]["traces"]] == list(drawn)  # each frame moves its own traces
    for axis in "xyz":
        low, high = figure["layout"]["scene"][f"{axis}axis"]["range"]
        every = [v for f in figure["frames"] for trace in f["data"] for v in trace[axis] if v is not None]
        assert low < min(every) < max(every) < high
        assert figure["layout"]["scene"][f"{axis}axis"]["title"]["text"].endswith("[m]")
    assert not [trace for trace in drawn.values() if trace.get("showlegend") is False]  # all that is drawn has a name
    assert made.png.startswith(b"\x89PNG")
