"""`qpal crawl`: stand and walk with the whole quadruped."""

from typing import Annotated

import typer

from twin.cli import console, options
from twin.cli.output import run_folder

PICTURES, DRAWING = 450.0, 30.0  # as many seconds of one robot are simulated in that time


def crawl(
    steps: Annotated[int, options.whole_number("N", "number of steps; four are one gait cycle")] = 8,
    duration: Annotated[float, options.number("S", "seconds to stand with power, and again without")] = 30.0,
    robots: Annotated[int, options.whole_number("N", "number of additional robots with other friction and mass")] = 12,
    seed: Annotated[int, options.whole_number("N", "seed of the additional robots and of the potentiometer noise")] = 1,
    params: options.Params = None,
    out: options.Out = None,
    as_json: options.Json = False,
) -> None:
    """Simulate the quadruped standing and walking.

    It walks a slow crawl with its twelve joints in servo mode.

    Limit: 400 steps, 1 h of standing, 1000 robots. Progress: time left.
    """
    from sysid.report.page import write
    from twin.report import crawl as report
    from twin.robot import crawl as walking
    from twin.robot.gait import Gait
    from twin.view.pictures import CrawlPictures, crawl_pictures
    from twin.view.stills import NoRenderer

    shares = (*walking.shares(walking.cycles(steps), duration, robots), PICTURES, DRAWING)
    progress = console.progress(len(shares), shares, not as_json, known=True)
    gait, parameters = Gait(cycles=walking.cycles(steps)), options.parameters(params)
    with run_folder(out, "crawl") as (folder, scratch), progress as step:
        result = walking.run(gait, parameters, duration, robots, options.seed(seed), threads=0, steps=step)
        step("pictures of the robot")
        images: CrawlPictures | str
        try:
            images = crawl_pictures(result)
        except NoRenderer as reason:
            images = str(reason)
        step("drawing the report")
        write(scratch, report.page(result, images), result.as_dict())
    console.finish(folder, result.as_dict(), as_json, report.tables(result), report.sentences(result))
    if not result.holds:
        raise typer.Exit(1)
