"""The drawn wiring and the tables of docs/rig.md have the pins that the firmware drives and reads."""

import re
import runpy
from pathlib import Path

ROOT = Path(__file__).parents[2]
# The pins of an Arduino Mega 2560 by the processor's: its pin map, and section 13.3 of Microchip's DS40002211.
OUTPUTS = {"OC3A": "5", "OC3B": "2", "OC4A": "6", "OC4B": "7", "OC5A": "46", "OC5B": "45"}
PINS = {"PE3": "5", "PE4": "2", "PH3": "6", "PH4": "7", "PL3": "46", "PL4": "45"}
PINS |= {"PA0": "22", "PA1": "23", "PA2": "24", "PC7": "30"}


def diagram():
    return runpy.run_path(str(ROOT / "scripts" / "rig_wiring.py"))


def driven_by_the_code():
    """Forward, backward and enable of each joint as board.c drives them, whatever its comments say."""
    code = (ROOT / "twin" / "rig" / "firmware" / "board.c").read_text()
    calls = re.findall(r"drive\(&TCCR(\d)A, &OCR(\w+), &OCR(\w+), out->on\[(\d)\]", code)
    enables = re.search(r"#define ENABLES (.*)", code)[1]
    assert [int(joint) for *_, joint in calls] == [0, 1, 2]
    assert "enables | (out->on[j] << j)" in code  # joint j has bit j of port A
    assert re.findall(r"PA\d", enables) == ["PA0", "PA1", "PA2"]
    outputs = [PINS[pin] for ports in re.findall(r"DDR[EHL] = (.*);", code) for pin in re.findall(r"P[EHL]\d", ports)]
    assert outputs == [OUTPUTS[f"OC{name}"] for _, *pair, _ in calls for name in pair]
    assert "in->readings[j] = (int16_t)scan[j]" in code
    assert "in->supply = (int16_t)scan[3]" in code
    key = re.search(r"in->key = \(PINC & \(1 << (PC\d)\)\)", code)[1]
    joints = [
        (f"A{j}", OUTPUTS[f"OC{forward}"], OUTPUTS[f"OC{backward}"], PINS[f"PA{j}"])
        for j, (_, forward, backward, _) in enumerate(calls)
    ]
    return joints, "A3", PINS[key]


def test_the_header_names_the_pins_that_the_code_drives():
    assert diagram()["pins"]() == driven_by_the_code()


def test_the_picture_is_drawn_from_them_anew():
    drawn = diagram()
    picture = (ROOT / "docs" / "rig-wiring.svg").read_text(encoding="utf-8")
    assert picture == drawn["svg"](), "python scripts/rig_wiring.py draws it"
    joints, supply, key = driven_by_the_code()
    bold = re.findall(r'font-weight="bold">([^<]*)<', picture)
    for pin in (*(pin for joint in joints for pin in joint), supply, key):
        assert bold.count(pin) == 1


def test_the_table_of_the_page_has_them():
    page = (ROOT / "docs" / "rig.md").read_text(encoding="utf-8")
    joints, supply, key = driven_by_the_code()
    for number, (wiper, forward, backward, enable) in enumerate(joints):
        assert f"| {number} | {wiper} | {forward}, {backward} | {enable} |" in page
    assert f"divided supply is on {supply} and the stop key on {key}" in page
