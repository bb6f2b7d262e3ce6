"""The wiring diagram of docs/rig.md, drawn from the pin table of the firmware: docs/rig-wiring.svg.

python scripts/rig_wiring.py
"""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
HEADER = ROOT / "twin" / "rig" / "firmware" / "board.h"
PICTURE = ROOT / "docs" / "rig-wiring.svg"
JOINT = r"(\d) +(A\d) +D(\d+) +\(\w+\), D(\d+) +\(\w+\) +D(\d+) \(\w+\)"
OTHERS = r"(A\d) is the supply behind a divider, D(\d+) \(\w+\) the stop key"

INK, WIRE, POWER, GREY, BOARD = "#1f2933", "#2f6f8f", "#c2410c", "#52606d", "#dbe7ee"
WIDTH, HEIGHT = 1200, 780
LEFT, RIGHT = 430, 620  # edges of the board
TOP, STEP = 150, 190  # the row of the first joint, and to the next [px]


def pins() -> tuple[list[tuple[str, ...]], str, str]:
    """Wiper, forward, backward and enable of each joint, then supply and stop key, as the firmware has them."""
    text = HEADER.read_text(encoding="utf-8")
    joints = [found[1:] for found in re.findall(JOINT, text)]
    others = re.search(OTHERS, text)
    assert len(joints) == 3
    assert others
    return joints, others[1], others[2]


def line(*points: tuple[float, float], colour: str = WIRE, width: float = 2.0) -> str:
    """A wire along points."""
    path = " ".join(f"{x:g},{y:g}" for x, y in points)
    return f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="{width:g}"/>'


def text(
    x: float, y: float, words: str, anchor: str = "start", colour: str = INK, size: int = 15, bold: bool = False
) -> str:
    """Words whose base line begins, ends or has its middle at x, y."""
    weight = ' font-weight="bold"' if bold else ""
    return f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}" fill="{colour}" font-size="{size}"{weight}>{words}</text>'


def box(x: float, y: float, wide: float, high: float, fill: str = "#ffffff") -> str:
    """A part with a frame."""
    place = f'x="{x:g}" y="{y:g}" width="{wide:g}" height="{high:g}" rx="6"'
    return f'<rect {place} fill="{fill}" stroke="{INK}" stroke-width="1.5"/>'


def dot(x: float, y: float, colour: str = WIRE) -> str:
    """Where wires meet."""
    return f'<circle cx="{x:g}" cy="{y:g}" r="4" fill="{colour}"/>'


def ground(x: float, y: float) -> str:
    """The one ground point."""
    bars = ((0, 12), (5, 8), (10, 4))
    return "".join(line((x - half, y + down), (x + half, y + down), colour=INK) for down, half in bars)


def resistor(x: float, y: float, words: str, colour: str = WIRE, side: int = 1) -> str:
    """A resistor that stands on the ground, from y down to y + 62, with its value on one side."""
    anchor = "start" if side > 0 else "end"
    return (
        line((x, y), (x, y + 12), colour=colour)
        + box(x - 6, y + 12, 12, 32)
        + line((x, y + 44), (x, y + 58), colour=INK)
        + ground(x, y + 58)
        + text(x + 12 * side, y + 33, words, anchor, GREY, 14)
    )


def potentiometer(number: int, y: float, pin: str) -> str:
    """A joint's potentiometer between 5 V and ground, its wiper at a pin, and what keeps a loose wiper at 0."""
    x = 190
    return (
        text(x - 24, y - 4, f"joint {number}", "end", bold=True)
        + text(x - 24, y + 16, "potentiometer", "end", GREY, 14)
        + text(x - 24, y + 34, "1 to 10 kΩ", "end", GREY, 14)
        + text(x, y - 58, "5 V of the board", "middle", POWER, 14)
        + line((x, y - 52), (x, y - 32), colour=POWER)
        + box(x - 8, y - 32, 16, 64)
        + line((x, y + 32), (x, y + 48), colour=INK)
        + ground(x, y + 48)
        + line((x + 8, y), (LEFT, y))
        + f'<path d="M{x + 9} {y} l12 -6 v12 z" fill="{WIRE}"/>'
        + dot(310, y)
        + resistor(310, y, "470 kΩ")
        + text(LEFT + 10, y + 5, pin, bold=True)
    )


def bridge(number: int, y: float, joint: tuple[str, ...]) -> str:
    """An H-bridge with its three inputs and its motor."""
    x, inputs = 800, ("PWM forward", "PWM backward", "enable")
    rows = [y - 44, y - 14, y + 16]
    drawn = box(x, y - 70, 150, 116)
    for words, pin, row in zip(inputs, joint[1:], rows, strict=True):
        drawn += line((RIGHT, row), (x, row)) + text(RIGHT - 10, row + 5, pin, "end", bold=True)
        drawn += text(x + 8, row + 5, words, size=14)
    drawn += dot(705, rows[2]) + resistor(705, rows[2], "10 kΩ")
    drawn += text(x + 75, y - 78, f"H-bridge, joint {number}", "middle", bold=True)
    for row in (y - 30, y + 2):
        drawn += line((x + 150, row), (1010, row), colour=INK)
    drawn += f'<circle cx="1020" cy="{y - 14}" r="24" fill="#ffffff" stroke="{INK}" stroke-width="1.5"/>'
    drawn += text(1020, y - 8, "M", "middle", bold=True)
    drawn += line((x + 110, y + 46), (x + 110, y + 60), (1110, y + 60), colour=POWER, width=3) + dot(
        1110, y + 60, POWER
    )
    return drawn + line((x + 30, y + 46), (x + 30, y + 58), colour=INK) + ground(x + 30, y + 58)


def svg() -> str:
    """The diagram."""
    joints, supply, key = pins()
    drawn = box(LEFT, 60, RIGHT - LEFT, 675, BOARD)
    drawn += text((LEFT + RIGHT) / 2, 350, "Arduino", "middle", size=19, bold=True)
    drawn += text((LEFT + RIGHT) / 2, 374, "Mega 2560", "middle", size=19, bold=True)
    drawn += line((525, 60), (525, 28)) + text(535, 34, "USB to this computer")
    drawn += line((460, 60), (460, 28), colour=POWER) + text(450, 34, "5 V", "end", POWER, 14)
    drawn += text(460, 80, "5V", "middle", bold=True) + text(525, 725, "GND", "middle", bold=True)
    drawn += line((525, 735), (525, 748), colour=INK) + ground(525, 748)
    for number, joint in enumerate(joints):
        drawn += potentiometer(number, 130 + 150 * number, joint[0])
        drawn += bridge(number, TOP + STEP * number, joint)
    y = 570  # the divider hangs from the supply, its lower half stands on the ground
    drawn += text(190, y - 42, "+ of the supply, behind its switch", "middle", POWER, 14)
    drawn += (
        line((190, y - 36), (190, y - 26), colour=POWER)
        + box(184, y - 26, 12, 32)
        + text(202, y - 5, "27 kΩ", colour=GREY, size=14)
    )
    drawn += line((190, y + 6), (190, y + 16)) + line((190, y + 16), (LEFT, y + 16)) + dot(190, y + 16)
    drawn += resistor(190, y + 16, "10 kΩ") + text(166, y + 4, "supply", "end", bold=True)
    drawn += text(166, y + 24, "divided", "end", GREY, 14) + text(LEFT + 10, y + 21, supply, bold=True)
    y = 690
    drawn += (
        line((LEFT, y), (280, y)) + dot(280, y) + line((284, y), (226, y - 3), colour=INK, width=3) + dot(230, y, INK)
    )
    drawn += line((230, y), (190, y), (190, y + 8), colour=INK) + ground(190, y + 8)
    drawn += line((255, y - 2), (255, y - 22), colour=INK) + line((243, y - 22), (267, y - 22), colour=INK, width=4)
    drawn += text(166, y - 6, "stop key", "end", bold=True) + text(166, y + 14, "normally closed", "end", GREY, 14)
    drawn += text(LEFT + 10, y + 5, key, bold=True)
    y = TOP + 2 * STEP + 60
    drawn += line((1110, TOP + 60), (1110, y + 55), colour=POWER, width=3)
    drawn += (
        dot(1110, y + 55, POWER)
        + line((1110, y + 59), (1090, y + 86), colour=POWER, width=3)
        + dot(1110, y + 90, POWER)
    )
    drawn += text(1076, y + 68, "switch", "end", bold=True) + text(1076, y + 87, "within reach", "end", GREY, 14)
    drawn += line((1110, y + 90), (1110, y + 108), colour=POWER, width=3) + box(1050, y + 108, 120, 44)
    drawn += text(1110, y + 136, "supply 12 V", "middle", bold=True)
    drawn += line((1110, y + 152), (1110, y + 164), colour=INK) + ground(1110, y + 164)
    drawn += text(RIGHT + 30, 690, "All grounds meet in one point:", colour=GREY, size=14)
    drawn += text(RIGHT + 30, 710, "supply, bridges, board, key.", colour=GREY, size=14)
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}"'
    body = f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>{drawn}'.replace("><", ">\n<")
    return f'{head} font-family="Helvetica, Arial, DejaVu Sans, sans-serif">\n{body}\n</svg>\n'


if __name__ == "__main__":
    PICTURE.write_text(svg(), encoding="utf-8")
    print(PICTURE)
