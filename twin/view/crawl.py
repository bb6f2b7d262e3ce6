"""Pictures of a crawl: stills of its moves and a film, by MuJoCo's offscreen renderer."""

from dataclasses import dataclass

import numpy as np

from twin.plant.leg import robot
from twin.robot.crawl import Crawl
from twin.view.stills import draw_robot

STILL, FRAME = (480, 360), (400, 300)  # [pixel]
FRAMES = 60  # of the film, about
FILM_SECONDS = 8.0  # that it lasts


@dataclass(frozen=True)
class Pictures:
    """`stills`: label, time [s] and picture (360, 480, 3); `film` (n, 300, 400, 3) lasts FILM_SECONDS and runs
    at `times` the real speed [1]. All uint8."""

    stills: list[tuple[str, float, np.ndarray]]
    film: list[np.ndarray]
    times: float


def pictures(result: Crawl) -> Pictures:
    """Pictures of the nominal robot's crawl. Raises twin.view.stills.NoRenderer if this machine cannot draw."""
    walk, moves = result.walk, result.plan.moves
    ends = [start for start, _ in moves[1:]] + [len(walk.qpos)]
    first = [(name, (start + end) // 2) for (start, name), end in zip(moves, ends, strict=True)][:8]
    chosen = [(f"{name} swings", k) for name, k in first if name not in ("stand", "body moves")]
    chosen = [("start", 0), *chosen, ("end", len(walk.qpos) - 1)]
    middle = 0.5 * (walk.torso[0, 0] + walk.torso[-1, 0])
    camera = {"lookat": (middle, 0.0, 0.24), "distance": 1.05 + middle, "azimuth": 122.0, "elevation": -14.0}
    model = robot(walk.parameters)
    stills = draw_robot(walk.qpos[[k for _, k in chosen]], camera, model, STILL)
    frames = np.unique(np.linspace(0, len(walk.qpos) - 1, FRAMES).astype(int))
    film = draw_robot(walk.qpos[frames], camera, model, FRAME)
    return Pictures(
        [(name, float(walk.t[k]), picture) for (name, k), picture in zip(chosen, stills, strict=True)],
        film,
        float(walk.t[-1]) / FILM_SECONDS,
    )
