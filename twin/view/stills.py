"""Pictures of the robot by MuJoCo's offscreen renderer, and the actuators' cylinders that every view adds.

The renderer runs in its own process: without OpenGL the process may be killed, and only a test shows which backend
works. The process gets a compiled model and poses, so it draws any model of this leg.
"""

import copy
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.base.locks import scratch_folder
from sysid.base.parallel import end_with
from twin.hardware.linkage import end_angles, middle
from twin.parameters import JOINTS, Parameters
from twin.plant.leg import BENCH_LEG, LEGS, robot

BACKENDS = {"darwin": ("cgl",), "win32": ("wgl",)}.get(sys.platform, ("egl", "osmesa"))
TIMEOUT = 60.0  # [s] for a backend to start and draw a first picture; software rendering takes a few
PER_PICTURE = 3.0  # [s] more for each picture
WIDTH, HEIGHT = 640, 480
FILM = 1024, 4  # pixels of a side of the shadow map, and samples of a pixel, in the frames of a film
# A camera: the point it looks at [m], its distance from there [m], azimuth and elevation [deg], and whether the point
# is relative to the torso instead of the floor's origin, so that a walking robot stays in the picture.
CAMERA: Mapping[str, Any] = {
    "lookat": (0.0, 0.0, 0.19),
    "distance": 1.4,
    "azimuth": 140.0,
    "elevation": -18.0,
    "follow": False,
}
_FROM_THE_FRONT = {"lookat": (0.16, 0.27, 0.35), "distance": 0.84, "azimuth": 196.0, "elevation": -12.0}
VIEWS: Mapping[str, Mapping[str, Any]] = {
    "shoulder": {"lookat": (0.13, 0.27, 0.36), "distance": 0.88, "azimuth": 200.0, "elevation": -48.0},
    "thigh": _FROM_THE_FRONT,
    "shank": _FROM_THE_FRONT,
}
TORSO_HEIGHT = 0.46  # [m] on its stand: no foot reaches the floor
FADED = (0.75, 0.78, 0.82, 0.28)  # the three legs that a still does not show
UNSEEN = 5  # a group that viewers hide by default
STAND = (0.35, 0.38, 0.43, 1.0)


class NoRenderer(RuntimeError):  # noqa: N818 - reads as what it says
    """This machine cannot draw; the text says which backends were tried."""


class Rod(NamedTuple):
    """A cylinder of `radius` [m] between two points [m], in a colour (red, green, blue, opacity)."""

    radius: float
    start: np.ndarray
    stop: np.ndarray
    colour: Sequence[float] | np.ndarray


def draw_robot(
    qpos: np.ndarray,
    camera: Mapping[str, Any] | None = None,
    model: mujoco.MjModel | None = None,
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> list[np.ndarray]:
    """Pictures (height, width, 3) uint8 of the robot on its floor, one for each pose in `qpos` (n, nq).

    `model` is the one that the poses come from, by default `robot()`. `camera` changes entries of `CAMERA`. Raises
    InputError if the poses do not fit the model, NoRenderer if this machine cannot draw.
    """
    model = robot() if model is None else model
    qpos = np.atleast_2d(np.asarray(qpos, dtype=float))
    return draw(model, qpos, [camera or {}] * len(qpos), size=size)


def leg_stills() -> list[tuple[str, str, np.ndarray]]:
    """(joint, "min" or "max", picture (480, 640, 3) uint8) at both ends of every joint's travel, the backlash centred.

    Raises NoRenderer if no picture can be made.
    """
    parameters = Parameters()
    model = robot(parameters)
    tint(model, {suffix: FADED for suffix in LEGS.values() if suffix != BENCH_LEG})
    cases = [
        (joint, end, angle)
        for joint in JOINTS
        for end, angle in zip(("min", "max"), end_angles(parameters, joint), strict=True)
    ]
    poses = [on_stand(model, parameters, {joint: angle}) for joint, _, angle in cases]
    pictures = draw(model, np.array(poses), [VIEWS[joint] for joint, _, _ in cases], stand=True)
    return [(joint, end, picture) for (joint, end, _), picture in zip(cases, pictures, strict=True)]


def on_stand(model: mujoco.MjModel, parameters: Parameters, angles: Mapping[str, float]) -> np.ndarray:
    """Pose (nq,) of `model`, a robot: the bench leg at `angles` [rad] by joint, every other joint at mid stroke."""
    qpos = mid_stroke(model, parameters)
    qpos[_address(model, "float") + 2] = TORSO_HEIGHT
    for joint, angle in angles.items():
        qpos[_address(model, joint + BENCH_LEG)] = angle
    return qpos


def mid_stroke(model: mujoco.MjModel, parameters: Parameters) -> np.ndarray:
    """Pose (nq,) of `model`, a robot, with every joint at mid stroke and the torso at its place in the model."""
    qpos = np.array(model.qpos0)
    for suffix in LEGS.values():
        for joint in JOINTS:
            qpos[_address(model, joint + suffix)] = middle(parameters, joint)
    return qpos


def leg_points(data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Points [m] of the bench leg: (4, 3) shoulder, hip, knee and foot; (4, 3) both ends of the thigh's actuator and of
    the shank's."""
    links = [data.body(f"{name}{BENCH_LEG}").xpos for name in ("shoulder_hub", "thigh_lever", "shank_lever")]
    ends = [data.site(f"{joint}_{end}{BENCH_LEG}").xpos for joint in JOINTS[1:] for end in ("base", "rod")]
    return np.array([*links, data.site(f"foot{BENCH_LEG}").xpos]), np.array(ends)


def _address(model: mujoco.MjModel, joint: str) -> int:
    return int(model.joint(joint).qposadr[0])


def tint(model: mujoco.MjModel, colours: Mapping[str, Sequence[float]]) -> None:
    """Give the legs with these suffixes one colour each, actuators included; opacity 0 hides a leg."""
    for suffix, colour in colours.items():
        for rgba, material, group, names in (
            (model.geom_rgba, model.geom_matid, model.geom_group, [model.geom(k).name for k in range(model.ngeom)]),
            (
                model.tendon_rgba,
                model.tendon_matid,
                model.tendon_group,
                [model.tendon(k).name for k in range(model.ntendon)],
            ),
        ):
            is_leg = [name.endswith(suffix) for name in names]
            rgba[is_leg], material[is_leg] = colour, -1
            if colour[3] == 0:
                group[is_leg] = UNSEEN  # opacity 0 alone would still cast a shadow


def cylinders(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[Rod]:
    """The actuators' cylinders from their base pins; MuJoCo itself draws the rods, as tendons.

    A cylinder ends short of the rod's pin at every stroke: at eight tenths of the retracted length.
    """
    for suffix in LEGS.values():
        for joint in JOINTS[1:]:
            colour = _colour(model, f"{joint}_actuator{suffix}")
            if colour[3] == 0:
                continue
            base, rod = data.site(f"{joint}_base{suffix}").xpos, data.site(f"{joint}_rod{suffix}").xpos
            direction = (rod - base) / np.linalg.norm(rod - base)
            tendon = model.tendon(joint + suffix).id
            tip = base + direction * 0.8 * model.tendon_range[tendon, 0]
            scale = model.tendon_width[tendon] / model.tendon_width.max()  # a ghost leg is a little thinner
            yield Rod(0.013 * scale, base, tip, colour)
            yield Rod(0.017 * scale, base, base + 0.35 * (tip - base), colour)


def column(data: mujoco.MjData) -> Iterator[Rod]:
    """A column with a foot, from the floor to the torso's underside."""
    x, y, z = data.body("torso").xpos
    yield Rod(0.035, np.array([x, y, 0.0]), np.array([x, y, z - 0.06]), STAND)
    yield Rod(0.12, np.array([x, y, 0.0]), np.array([x, y, 0.012]), STAND)


def _colour(model: mujoco.MjModel, geom: str) -> np.ndarray:
    k = model.geom(geom).id
    material = model.geom_matid[k]
    return model.geom_rgba[k] if material < 0 else model.mat_rgba[material]


def shape(geom: mujoco.MjvGeom, rod: Rod) -> None:
    """Make `geom` of a scene the cylinder `rod`."""
    kind = mujoco.mjtGeom.mjGEOM_CYLINDER
    mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.zeros(9), np.asarray(rod.colour, dtype=np.float32))
    mujoco.mjv_connector(geom, kind, rod.radius, rod.start, rod.stop)
    geom.specular, geom.shininess = 0.5, 0.5


def draw(
    model: mujoco.MjModel,
    qpos: np.ndarray,
    cameras: Sequence[Mapping[str, Any]],
    *,
    stand: bool = False,
    size: tuple[int, int] = (WIDTH, HEIGHT),
    film: bool = False,
) -> list[np.ndarray]:
    """Pictures (height, width, 3) uint8 of `model`, a robot, in the poses `qpos` (n, nq), each from its own camera.

    `stand` puts a column under the torso. `film` draws shadows and edges less finely, in less than half the time where
    software draws. Raises InputError for poses or cameras that do not fit, NoRenderer if this machine cannot draw.
    """
    _check(model, qpos, cameras, size)
    if film:
        model = copy.copy(model)  # a full copy
        model.vis.quality.shadowsize, model.vis.quality.offsamples = FILM
    reasons = []
    path = os.pathsep.join(filter(None, (str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH"))))
    limit = TIMEOUT + PER_PICTURE * len(qpos)
    with scratch_folder() as folder:
        mujoco.mj_saveModel(model, str(folder / "model.mjb"))
        full = [{**CAMERA, **camera} for camera in cameras]
        views = {f"camera_{entry}": np.array([camera[entry] for camera in full]) for entry in CAMERA}
        np.savez(folder / "request.npz", allow_pickle=False, qpos=qpos, stand=stand, size=size, **views)
        for backend in BACKENDS:
            try:
                process = subprocess.run(
                    [sys.executable, "-m", "twin.view.stills", str(folder), str(os.getpid())],
                    env={**os.environ, "MUJOCO_GL": backend, "PYTHONPATH": path},
                    capture_output=True,
                    text=True,
                    timeout=limit,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                reasons.append(f"{backend}: no answer within {limit:g} s")
                continue
            if process.returncode == 0 and (folder / "pictures.npy").is_file():
                return list(np.load(folder / "pictures.npy"))
            lines = process.stderr.strip().splitlines()
            reasons.append(f"{backend}: {lines[-1] if lines else f'the process ended with {process.returncode}'}")
    raise NoRenderer(f"no picture of the leg: no offscreen renderer works here ({'; '.join(reasons)})")


def _check(
    model: mujoco.MjModel, qpos: np.ndarray, cameras: Sequence[Mapping[str, Any]], size: tuple[int, int]
) -> None:
    """Raises InputError for poses, cameras or a size that do not fit the model."""
    if qpos.ndim != 2 or qpos.shape[1] != model.nq or not len(qpos) or not np.isfinite(qpos).all():
        raise InputError(
            f"the poses have shape {qpos.shape}; give at least one pose of {model.nq} finite numbers, or the model "
            "that they come from"
        )
    if len(cameras) != len(qpos):
        raise InputError(f"there are {len(cameras)} cameras for {len(qpos)} poses; give one camera for each pose")
    for name in sorted({name for camera in cameras for name in camera}):
        if name not in CAMERA:
            raise unknown("camera entry", name, CAMERA)
    largest = model.vis.global_.offwidth, model.vis.global_.offheight
    if not all(1 <= side <= largest_side for side, largest_side in zip(size, largest, strict=True)):
        raise InputError(f"the picture size is {size[0]} x {size[1]}; this model draws up to {largest}")


def _draw_here(folder: Path) -> None:
    """The work of the separate process: from the request in `folder` to pictures.npy (n, height, width, 3)."""
    model = mujoco.MjModel.from_binary_path(str(folder / "model.mjb"))
    data = mujoco.MjData(model)
    option = mujoco.MjvOption()
    option.flags[mujoco.mjtVisFlag.mjVIS_ACTUATOR] = False
    pictures = []
    with np.load(folder / "request.npz") as request:
        on_column, views = bool(request["stand"]), {name: request[f"camera_{name}"] for name in CAMERA}
        qpos, (width, height) = request["qpos"], request["size"].tolist()
    with mujoco.Renderer(model, height, width) as renderer:
        for k, pose in enumerate(qpos):
            data.qpos[:] = pose
            mujoco.mj_fwdPosition(model, data)
            renderer.update_scene(data, _camera({name: values[k] for name, values in views.items()}, data), option)
            for rod in (*cylinders(model, data), *(column(data) if on_column else ())):
                shape(renderer.scene.geoms[renderer.scene.ngeom], rod)
                renderer.scene.ngeom += 1
            pictures.append(renderer.render().copy())
    np.save(folder / "pictures.npy", np.array(pictures))


def _camera(view: Mapping[str, Any], data: mujoco.MjData) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.distance, camera.azimuth, camera.elevation = view["distance"], view["azimuth"], view["elevation"]
    camera.lookat[:] = view["lookat"]
    if view["follow"]:
        camera.lookat[:2] += data.body("torso").xpos[:2]
    return camera


if __name__ == "__main__":
    end_with(int(sys.argv[2]))
    _draw_here(Path(sys.argv[1]))
