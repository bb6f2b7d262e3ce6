"""Pictures of the leg at both ends of each joint's travel, by MuJoCo's offscreen renderer.

The renderer runs in a process of its own: a machine without OpenGL may kill the process that tries, and which backend
works is known only after trying.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from twin.geometry import end_angles, middle
from twin.leg import BENCH_LEG, LEGS, robot
from twin.parameters import JOINTS, Parameters

BACKENDS = {"darwin": ("cgl",), "win32": ("wgl",)}.get(sys.platform, ("egl", "osmesa"))
TIMEOUT = 60.0  # [s] a backend gets to draw all of them; software rendering takes a few
WIDTH, HEIGHT = 640, 480
# Where the camera looks, how far away, azimuth and elevation [deg]: from the front, or from above for the shoulder.
VIEWS = {
    "shoulder": ((0.13, 0.27, 0.36), 0.88, 200.0, -48.0),
    "thigh": ((0.16, 0.27, 0.35), 0.84, 196.0, -12.0),
    "shank": ((0.16, 0.27, 0.35), 0.84, 196.0, -12.0),
}
TORSO_HEIGHT = 0.46  # [m] on its stand: no foot reaches the floor
GHOST = (0.75, 0.78, 0.82, 0.28)  # the three legs that the picture is not about
STAND = (0.35, 0.38, 0.43, 1.0)


class NoRenderer(RuntimeError):  # noqa: N818 - reads as what it says
    """This machine cannot draw; the text says what was tried."""


def leg_stills() -> list[tuple[str, str, np.ndarray]]:
    """(joint, "min" or "max", picture (480, 640, 3) uint8) at both ends of every joint's travel, play centred.

    Raises NoRenderer where none can be made.
    """
    reasons = []
    path = os.pathsep.join(filter(None, (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH"))))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "stills.npz"
        for backend in BACKENDS:
            try:
                done = subprocess.run(
                    [sys.executable, "-m", "twin.stills", str(out)],
                    env={**os.environ, "MUJOCO_GL": backend, "PYTHONPATH": path},
                    capture_output=True,
                    text=True,
                    timeout=TIMEOUT,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                reasons.append(f"{backend}: nothing within {TIMEOUT:g} s")
                continue
            if done.returncode == 0 and out.is_file():
                with np.load(out) as pictures:
                    return [(joint, end, pictures[f"{joint}_{end}"]) for joint in JOINTS for end in ("min", "max")]
            last = done.stderr.strip().splitlines()
            reasons.append(f"{backend}: {last[-1] if last else f'the process ended with {done.returncode}'}")
    raise NoRenderer(f"no picture of the leg: no offscreen renderer works here ({'; '.join(reasons)})")


def draw() -> dict[str, np.ndarray]:
    """Pictures by name `joint_end`, drawn in this process."""
    parameters = Parameters()
    model = robot(parameters)
    _fade_other_legs(model)
    data = mujoco.MjData(model)
    pictures = {}
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        for joint in JOINTS:
            for end, angle in zip(("min", "max"), end_angles(parameters, joint), strict=True):
                _pose(model, data, parameters, joint, angle)
                renderer.update_scene(data, _camera(joint), _options())
                _draw_cylinders(data, renderer.scene, model.material("motor").rgba)
                _add(renderer.scene, 0.035, np.zeros(3), np.array([0, 0, TORSO_HEIGHT - 0.06]), STAND)
                _add(renderer.scene, 0.12, np.zeros(3), np.array([0, 0, 0.012]), STAND)
                pictures[f"{joint}_{end}"] = renderer.render().copy()
    return pictures


def _pose(model: mujoco.MjModel, data: mujoco.MjData, parameters: Parameters, joint: str, angle: float) -> None:
    mujoco.mj_resetData(model, data)
    data.joint("float").qpos[2] = TORSO_HEIGHT
    for suffix in LEGS.values():
        for name in JOINTS:
            data.joint(name + suffix).qpos[0] = middle(parameters, name)
    data.joint(joint + BENCH_LEG).qpos[0] = angle
    mujoco.mj_forward(model, data)


def _camera(joint: str) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    lookat, camera.distance, camera.azimuth, camera.elevation = VIEWS[joint]
    camera.lookat[:] = lookat
    return camera


def _options() -> mujoco.MjvOption:
    option = mujoco.MjvOption()
    option.flags[mujoco.mjtVisFlag.mjVIS_ACTUATOR] = False
    return option


def _fade_other_legs(model: mujoco.MjModel) -> None:
    for suffix in LEGS.values():
        if suffix == BENCH_LEG:
            continue
        for rgba, material, names in (
            (model.geom_rgba, model.geom_matid, [model.geom(k).name for k in range(model.ngeom)]),
            (model.tendon_rgba, model.tendon_matid, [model.tendon(k).name for k in range(model.ntendon)]),
        ):
            other = [name.endswith(suffix) for name in names]
            rgba[other], material[other] = GHOST, -1


def _draw_cylinders(data: mujoco.MjData, scene: mujoco.MjvScene, colour: Sequence[float]) -> None:
    """The actuators' cylinders from their base pins; MuJoCo itself draws the rods, as tendons."""
    nominal = Parameters()
    for suffix in LEGS.values():
        for joint in JOINTS[1:]:
            base, rod = data.site(f"{joint}_base{suffix}").xpos, data.site(f"{joint}_rod{suffix}").xpos
            along = (rod - base) / np.linalg.norm(rod - base)
            tip = base + along * 0.8 * nominal[f"{joint}.retracted_length"]
            shade = colour if suffix == BENCH_LEG else GHOST
            _add(scene, 0.013, base, tip, shade)
            _add(scene, 0.017, base, base + 0.35 * (tip - base), shade)


def _add(scene: mujoco.MjvScene, radius: float, start: np.ndarray, stop: np.ndarray, colour: Sequence[float]) -> None:
    """A cylinder of `radius` [m] between two points [m]."""
    geom = scene.geoms[scene.ngeom]
    shape = mujoco.mjtGeom.mjGEOM_CYLINDER
    mujoco.mjv_initGeom(geom, shape, np.zeros(3), np.zeros(3), np.zeros(9), np.asarray(colour, dtype=np.float32))
    mujoco.mjv_connector(geom, shape, radius, start, stop)
    geom.specular, geom.shininess = 0.5, 0.5
    scene.ngeom += 1


if __name__ == "__main__":
    np.savez(sys.argv[1], allow_pickle=False, **draw())
