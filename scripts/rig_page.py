"""The recording of the app's page Rig on an emulated leg: docs/rig-page.gif. It needs Chromium and chromedriver.

python scripts/rig_page.py [docs/rig-page.gif]
"""

import io
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from app_served import app, browser, until  # noqa: E402 - after the path to it

WIDTH, HEIGHT = 1280, 1000
COLOURS = 24
LONG, SHORT = 1600, 350  # [ms] that a frame stands: one to read, one of a movement


def main(target: Path) -> None:
    """Connect, check the wiring, run the first sweep and stop it; a frame for each step."""
    frames: list[tuple[Image.Image, int]] = []
    with (
        tempfile.TemporaryDirectory() as folder,
        app(Path(folder) / "leg") as served,
        browser(Path(folder), f"--window-size={WIDTH},{HEIGHT}") as page,
    ):

        def shot(stands: int = LONG) -> None:
            frames.append((Image.open(io.BytesIO(page.get_screenshot_as_png())).convert("RGB"), stands))

        def marked(name: str):
            return page.find_element("css selector", f'[data-mark="{name}"]')

        def click(name: str, seen: bool = True) -> None:
            until(lambda: marked(name).is_enabled(), name)
            page.execute_script("arguments[0].scrollIntoView({block: 'nearest'})", marked(name))
            time.sleep(0.5)
            if seen:
                shot()
            page.execute_script("arguments[0].click()", marked(name))
            time.sleep(0.5)

        page.get(served.address)
        until(lambda: marked("page-Rig"), "the page")
        page.execute_script("document.documentElement.style.overflowY = 'scroll'")  # a bar that comes moves all else
        click("page-Rig", seen=False)
        click("rig-connect")
        click("rig-wire", seen=False)
        click("rig-yes-wire")
        for _ in range(3):
            time.sleep(1.2)
            shot(SHORT)
        click("rig-zero", seen=False)
        click("rig-yes-zero")
        for _ in range(2):
            time.sleep(1.0)
            shot(SHORT)
            until(lambda: marked("rig-question"), "an end")
            click("rig-answer")
        until(lambda: marked("rig-input"), "the ends")
        page.execute_script("arguments[0].click()", marked("rig-input"))
        until(lambda: page.find_elements("css selector", ".q-menu .q-item"), "the inputs")[0].click()
        click("rig-run", seen=False)
        click("rig-yes-run")
        page.execute_script("scrollTo(0, 0)")
        for _ in range(7):
            time.sleep(1.2)
            shot(SHORT)
        click("rig-stop")
        until(lambda: marked("rig-identify"), "the log")
        page.execute_script("arguments[0].scrollIntoView({block: 'nearest'})", marked("rig-identify"))
        time.sleep(0.7)
        shot(2 * LONG)
    save(frames, target)
    print(f"{target}: {len(frames)} frames, {target.stat().st_size / 1e3:.0f} kB")


def save(frames: list[tuple[Image.Image, int]], target: Path) -> None:
    """Write the frames with one palette, that of the busiest one."""
    palette = frames[-4][0].quantize(COLOURS, dither=Image.Dither.NONE)
    small = [frame.quantize(COLOURS, palette=palette, dither=Image.Dither.NONE) for frame, _ in frames]
    small[0].save(
        target, save_all=True, append_images=small[1:], duration=[stands for _, stands in frames], loop=0, optimize=True
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "rig-page.gif")
