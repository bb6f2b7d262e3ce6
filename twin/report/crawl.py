"""The report of `qpal crawl`: the robot stands and walks, from finished numbers and pictures."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from sysid.base import style
from sysid.base.files import versions
from sysid.base.quantities import number
from sysid.base.style import styled
from sysid.report.page import Grid, Page, Picture, Section
from twin.parameters import JOINTS
from twin.plant.leg import LEGS
from twin.robot.crawl import SPREAD, Crawl, margins
from twin.view.pictures import FILM_SECONDS, CrawlPictures

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#c2410c", "#2f6f8f", "#6b8e23", "#7a5195")  # of the legs
LOCKED = 1e-3  # [m] of sinking during the standing test
NAMES = tuple(leg.replace("_", " ") for leg in LEGS)


def page(result: Crawl, pictures: CrawlPictures | str) -> Page:
    """The report; `pictures` of the robot, or a sentence with the reason why there are none."""
    gait = result.plan.gait
    return Page(
        title="The quadruped stands and walks",
        subtitle=(
            f"{4 * gait.cycles} steps of {1000 * gait.stride:g} mm with twelve joints in servo mode, seed {result.seed}"
        ),
        verdict=sentences(result),
        sections=[
            _picture_section(pictures),
            Section("Walking", [_WALKING], tables=tables(result), pictures=_walking(result)),
            Section("Standing", [_standing_sentence(result)]),
            Section("Forces", [_FORCES], tables=[forces(result)]),
            Section("Joints", pictures=[_picture("joints", joints(result), _JOINTS)]),
            *([Section("Other robots", [_trials_sentence(result)], details=[robots(result)])] if result.trials else []),
        ],
        made_with=versions(),
    )


_WALKING = (
    "One foot is in the air at a time, in the order rear left, front left, rear right, front right; the body moves "
    "only while all four stand. The margin is the distance of the centre of mass from the edge of the triangle of "
    "the standing feet, seen from above; the robot tips over if it is negative."
)
_FORCES = (
    "Requirements of the plan on each actuator: the load that it holds, which is largest while three feet stand, and "
    "the force for motion, friction included. The motor must provide more than that at the share of the supply that "
    "the plan uses. A lower body moves the knees outwards and increases the load on the actuators of the shanks."
)
_JOINTS = (
    "Planned and actual angle of each joint. A joint at rest may keep an error: with a proportional gain only, the "
    "position loop asks for less than the dry friction."
)


def sentences(result: Crawl) -> list[str]:
    """The outcome in plain words."""
    m, s = result.measures, result.standing
    walk_sentence = (
        f"The robot walked {1000 * m.forward:.0f} mm in {m.seconds:.0f} s ({1000 * m.speed:.1f} mm/s; planned "
        f"{1000 * result.plan.advance:.0f} mm). Its torso never tilted by more than {np.degrees(m.tilt):.1f} degrees, "
        f"and its centre of mass stayed {1000 * m.margin:.0f} mm or more inside the support."
    )
    failure = f"The robot did not walk: {result.fault}."
    standing_sentence = (
        f"While standing for {s.seconds:g} s it sank by {_sinking(s.sink)} with the servos on and by "
        f"{_sinking(s.sink_unpowered)} without power."
    )
    trials = [_trials_sentence(result)] if result.trials else []
    return [failure if result.fault else walk_sentence, standing_sentence, *trials]


def _standing_sentence(result: Crawl) -> str:
    s = result.standing
    return (
        f"The servos hold the robot for {s.seconds:g} s: the torso sinks by {_sinking(s.sink)} and tilts by "
        f"{np.degrees(s.tilt):.2f} degrees at most; the motors take {s.power:.1f} W, because the potentiometers' "
        f"noise keeps them active. Without voltage the torso sinks by {_sinking(s.sink_unpowered)}"
        + (": the screws are self-locking." if s.sink_unpowered < LOCKED else ".")
    )


def _trials_sentence(result: Crawl) -> str:
    low, high = result.rate
    interval = f" (95 % interval of the rate {100 * low:.0f} to {100 * high:.0f} %)" if len(result.trials) > 1 else ""
    return (
        f"{result.successes} of {len(result.trials)} robots with friction and masses drawn within {100 * SPREAD:.0f} "
        f"% of these values also walked with the same references{interval}."
    )


def _picture_section(pictures: CrawlPictures | str) -> Section:
    """The pictures of the robot, or why they are missing."""
    if isinstance(pictures, str):
        return Section("Pictures", [f"The pictures are missing: {pictures}."])
    swings = "The swing of each leg in the first cycle; the robot walks to the right."
    walk = f"The whole walk at {pictures.times:.1f} times its real speed (an animated PNG)."
    return Section(
        "Pictures", pictures=[_picture("strip", strip(pictures), swings), Picture("film", film(pictures), walk)]
    )


def _walking(result: Crawl) -> list[Picture]:
    """The figures of the walk."""
    return [
        _picture(
            "path",
            path(result),
            "(a) Feet and torso from the side, each foot steps once per cycle. (b) From above: the centre of mass "
            "(black) moves to the side of the standing legs before a leg is lifted, and stays inside each triangle "
            "while the leg of that colour is in the air.",
        ),
        _picture(
            "stability",
            stability(result),
            "Planned and actual margin of stability, and tilt of the torso; the swing of each leg has its colour. "
            "With four feet down the margin is far above the frame. Backlash and soft feet let the body lean a "
            "little towards the lifted leg.",
        ),
    ]


def _picture(name: str, figure: Figure, caption: str) -> Picture:
    return Picture(name, style.png(figure), caption)


def tables(result: Crawl) -> list[Grid]:
    """The walk in numbers."""
    m = result.measures
    shoulder, thigh, shank = (np.degrees(m.tracking[k::3]).max() for k in range(3))
    rows = [
        ("way forward, planned [mm]", _millimetres(result.plan.advance)),
        ("way forward [mm]", _millimetres(m.forward)),
        ("way sideways [mm]", _millimetres(m.sideways)),
        ("turn [deg]", number(float(np.degrees(m.turn)), 2)),
        ("time [s]", number(m.seconds, 3)),
        ("speed [mm/s]", number(1000 * m.speed, 2)),
        ("smallest margin, planned [mm]", _millimetres(float(result.plan.margin.min()))),
        ("smallest margin [mm]", _millimetres(m.margin)),
        ("largest tilt [deg]", number(float(np.degrees(m.tilt)), 2)),
        ("torso, lowest to highest [mm]", f"{1000 * m.height[0]:.1f} to {1000 * m.height[1]:.1f}"),
        ("largest slip of a standing foot [mm]", _millimetres(m.slip)),
        ("smallest rise of a swinging foot [mm]", _millimetres(m.clearance)),
        ("RMS error of the worst shoulder, thigh, shank [deg]", f"{shoulder:.2f}, {thigh:.2f}, {shank:.2f}"),
        ("electrical power, mean / peak [W]", f"{number(m.power, 2)} / {number(m.peak_power, 2)}"),
        ("largest motor voltage [V]", number(m.peak_voltage, 3)),
        ("cost of transport, power / (weight × speed)", number(m.transport, 2)),
    ]
    return [Grid(("the walk", "value"), rows)]


def forces(result: Crawl) -> Grid:
    """Loads, needs and stall forces, the worst of the four legs each."""
    rows = []
    for k, joint in enumerate(JOINTS):
        load, need, stall = (values[k::3].max() for values in (result.plan.load, result.plan.need, result.plan.stall))
        unit = "N m" if joint == "shoulder" else "N"
        values = (load, need, stall, result.plan.gait.effort * stall)
        rows.append((f"{joint} [{unit}]", *(number(float(value), 3) for value in values)))
    return Grid(("actuator", "largest load held", "largest force to move", "stall", "stall, planned with"), rows)


def robots(result: Crawl) -> Grid:
    """One row per drawn robot."""
    rows = [
        (
            str(k),
            _millimetres(t.measures.forward),
            _millimetres(t.measures.margin),
            number(float(np.degrees(t.measures.tilt)), 2),
            number(t.measures.power, 2),
            t.fault or "walked",
        )
        for k, t in enumerate(result.trials, 1)
    ]
    headings = ("robot", "way [mm]", "smallest margin [mm]", "largest tilt [deg]", "power [W]", "outcome")
    return Grid(headings, rows, "The drawn robots", last_text=True)


@styled
def strip(pictures: CrawlPictures) -> Figure:
    """Start, the swing of each leg, end."""
    columns = 3
    rows = -(-len(pictures.stills) // columns)
    figure, axes = style.sheet(rows, columns, height=0.1 + 2.2 * rows)
    for ax in axes.flat:
        ax.axis("off")
    for ax, (name, t, picture) in zip(axes.flat, pictures.stills, strict=False):
        ax.imshow(picture)
        ax.set_title(f"{t:.1f} s: {name}")
    return figure


def film(pictures: CrawlPictures) -> bytes:
    """The film as an animated PNG; its last picture stays for a second."""
    from PIL import Image

    # One palette for all frames: the parts that do not move are then equal in every frame and take no space.
    palette = Image.fromarray(pictures.film[0]).quantize(256, Image.Quantize.MAXCOVERAGE)
    plain = Image.Dither.NONE
    frames = [Image.fromarray(frame).quantize(palette=palette, dither=plain) for frame in pictures.film]
    duration = round(1000 * FILM_SECONDS / len(frames))
    buffer = io.BytesIO()
    durations = [duration] * (len(frames) - 1) + [1000]
    frames[0].save(buffer, "PNG", save_all=True, append_images=frames[1:], duration=durations, loop=0)
    return buffer.getvalue()


@styled
def path(result: Crawl) -> Figure:
    """Feet, torso and centre of mass from the side and from above [mm]."""
    (feet, _, centre), torso = result.walk.places, result.walk.torso
    figure, axes = style.sheet(2, height=6.6)
    side_view, top_view = axes[:, 0]
    for k, (name, colour) in enumerate(zip(NAMES, COLOURS, strict=True)):
        side_view.plot(1000 * feet[:, k, 0], 1000 * feet[:, k, 2], color=colour, label=name)
        top_view.plot(1000 * feet[:, k, 0], 1000 * feet[:, k, 1], color=colour, linewidth=0.8)
    side_view.plot(1000 * torso[:, 0], 1000 * torso[:, 2] - 300, color=style.INK)
    for start, name in result.plan.moves[:7]:  # the first cycle
        if name in NAMES:
            k = NAMES.index(name)
            corners = 1000 * np.delete(feet[start], k, axis=0)[[0, 1, 2, 0], :2]
            top_view.plot(*corners.T, color=COLOURS[k], linewidth=0.8, linestyle=":")
    top_view.plot(1000 * centre[:, 0], 1000 * centre[:, 1], color=style.INK, label="centre of mass")
    middle, height = 500 * (torso[0, 0] + torso[-1, 0]), 1000 * torso[:, 2].min() - 300
    side_view.text(middle, height - 3, "torso, shown 300 mm lower", color=style.INK, ha="center", va="top")
    side_view.set(title="(a) from the side", ylabel="height of the feet [mm]")
    top_view.set(title="(b) from above; standing feet dotted", xlabel="forward [mm]", ylabel="left [mm]")
    top_view.set_aspect("equal")
    style.legend(side_view)
    return figure


@styled
def stability(result: Crawl) -> Figure:
    """Margin of stability and tilt over time."""
    feet, _, centre = result.walk.places
    t, plan = result.walk.t, result.plan
    figure, axes = style.sheet(2, height=3.8, sharex=True)
    top, bottom = axes[:, 0]
    swings = ~plan.stance.all(axis=1)
    planned_margin = np.where(swings, 1000 * plan.margin, np.nan)
    walk_margin = np.where(swings, 1000 * margins(plan, feet, centre), np.nan)
    top.plot(t, planned_margin, color=style.SECOND, label="planned")
    top.plot(t, walk_margin, color=style.MODEL, label="walked")
    top.set(title="(a) margin of stability on three feet", ylabel="margin [mm]")
    top.set_ylim(bottom=min(0.0, float(np.nanmin(walk_margin))))
    bottom.plot(t, np.degrees(result.walk.tilt), color=style.INK)
    bottom.set(title="(b) tilt of the torso", ylabel="tilt [deg]", xlabel="time [s]")
    for ax in (top, bottom):
        _shade(ax, t, plan.stance)
    style.legend(top)
    return figure


def _shade(ax: Axes, t: np.ndarray, stance: np.ndarray) -> None:
    low, high = ax.get_ylim()
    for k, colour in enumerate(COLOURS):
        ax.fill_between(t, low, high, where=~stance[:, k], color=colour, alpha=0.08, linewidth=0)
    ax.set_ylim(low, high)


@styled
def joints(result: Crawl) -> Figure:
    """Planned and real angle of every joint, one row per leg."""
    figure, axes = style.sheet(4, 3, height=7.6, sharex=True)
    sides = (result.plan.angles, style.SECOND, "planned"), (result.walk.angles, style.MODEL, "walked")
    for i, (leg, row) in enumerate(zip(NAMES, axes, strict=True)):
        for j, (joint, ax) in enumerate(zip(JOINTS, row, strict=True)):
            for angles, colour, label in sides:
                style.line(ax, result.walk.t, np.degrees(angles[:, 3 * i + j]), color=colour, label=label)
            ax.set(title=f"{leg} {joint}", ylabel="" if j else "angle [deg]", xlabel="time [s]" if i == 3 else "")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    return figure


def _sinking(value: float) -> str:
    return f"{_millimetres(value)} mm" if value >= 5e-5 else "less than 0.1 mm"


def _millimetres(value: float) -> str:
    text = f"{1000 * value:.1f}"
    return "0.0" if text == "-0.0" else text.replace("-", "−")
