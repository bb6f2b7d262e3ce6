"""Every recipe of the table: named alike everywhere, described for people, and reachable from where it has to be."""

from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest
import typer
from cases import STRUCTURES

from sysid import structures
from sysid.base.errors import InputError
from sysid.blocks import ServoMotor
from sysid.data.record import IOData
from sysid.model.recipes import Option
from sysid.structures import (
    TABLE,
    ActuatedJoint,
    Hammerstein,
    HammersteinWiener,
    NonlinearArx,
    OutputError,
    ServoJoint,
    Wiener,
    WienerHammerstein,
)
from twin.cli.app import build
from twin.cli.recipes import recipe


def test_cases_have_every_structure():
    assert set(STRUCTURES) == set(TABLE)


@pytest.mark.parametrize("name", sorted(TABLE))
def test_a_recipe_and_its_model_bear_the_tables_name(name):
    assert TABLE[name].name == STRUCTURES[name].model().structure == name
    assert type(STRUCTURES[name]) is TABLE[name]


@pytest.mark.parametrize("name", sorted(TABLE))
def test_every_setting_is_described_and_an_option_of_identify(name):
    command = typer.main.get_command(build()).commands["identify"]
    helps = {parameter.name: parameter.help for parameter in command.params}
    for f in fields(TABLE[name]):
        option = f.metadata["option"]
        assert isinstance(option, Option)
        if option.kind != "order":
            assert option.help in helps[f.name]
            assert all(allowed in helps[f.name] for allowed in option.allowed)


@pytest.mark.parametrize("name", sorted(TABLE))
def test_the_command_line_gives_every_setting_to_its_recipe(name):
    """Orders of 4, 5, 6, ... in the order in which the structure names them; every other setting as in the cases."""
    orders = dict(zip(STRUCTURES[name].orders, range(4, 9), strict=False))
    text = {"orders": ",".join(map(str, orders.values()))} if orders else {}
    found = recipe(name, {**STRUCTURES[name].as_dict(), **text})
    assert type(found) is TABLE[name]
    assert found.orders == orders
    assert found.as_dict() == STRUCTURES[name].as_dict()


@pytest.mark.parametrize("name", sorted(TABLE))
def test_what_a_search_tries_of_a_structure_is_that_structure_and_it_can_come_back(name):
    """First settings that differ from each other, and neighbours of whom each has the setting as a neighbour."""
    data = IOData(np.array([-1.0, 1.0, 0.5]), np.array([-2.0, 2.0, 1.0]), 1.0)
    ladder = TABLE[name].ladder(data)
    assert ladder
    assert len(set(ladder)) == len(ladder)
    for c in (*ladder, STRUCTURES[name]):
        assert type(c) is TABLE[name]
        for other in c.neighbours():
            assert type(other) is TABLE[name]
            assert other != c
            assert c in other.neighbours()


@pytest.mark.parametrize("name", sorted(TABLE))
def test_records_of_what_counts_from_zero_keep_their_means(name):
    """Whoever refuses to have means removed puts them back; whoever does not leaves the record alone."""
    data = IOData(np.array([-1.0, 1.0]), np.array([-2.0, 2.0]), 1.0, u_offset=np.array([3.0]), y_offset=np.array([4.0]))
    scaled, kind = STRUCTURES[name].scale(data), TABLE[name]
    assert kind.detrend("none") == kind.detrend() == "none"
    if kind.zero:
        with pytest.raises(InputError, match=f"detrend is 'mean', and .*{name}.* count from zero"):
            kind.detrend("mean")
        np.testing.assert_array_equal(scaled.u[:, 0], [2.0, 4.0])
        np.testing.assert_array_equal(scaled.y[:, 0], [2.0, 6.0])
    else:
        assert kind.detrend("mean") == "mean"
        assert scaled is data


def test_settings_that_give_no_model_are_refused_before_any_work():
    for make, words in (
        (lambda: HammersteinWiener(0, 2, 1), "nb >= 1"),
        (lambda: HammersteinWiener(input_map="staircase"), "input map 'staircase'"),
        (lambda: NonlinearArx(focus="guess"), "focus 'guess'"),
        (lambda: ActuatedJoint(input_map="staircase"), "driver map 'staircase'"),
        (lambda: ActuatedJoint(sensor_linearity=-0.1), "linearity is -0.1"),
        (lambda: ServoJoint(loop="pdd"), "loop of a servo 'pdd'"),
        (lambda: ServoJoint(load="spring"), "load of a servo joint 'spring'"),
        (lambda: ServoJoint(kp=-2.0), "kp of the servo is -2.0"),
        (lambda: ServoJoint(limit=0.0), "limit is 0.0"),
    ):
        with pytest.raises(InputError, match=words):
            make()


def test_a_recipe_makes_the_chain_that_its_function_makes():
    """A map that is not named is the function's own default."""
    for found, expected in (
        (Hammerstein(4, 5, 6, "dead_zone"), structures.hammerstein(4, 5, 6, "dead_zone", offset="free")),
        (HammersteinWiener(4, 5, 6), structures.hammerstein_wiener(4, 5, 6)),
        (HammersteinWiener(4, 5, 6, None, "saturation"), structures.hammerstein_wiener(4, 5, 6, output="saturation")),
        (
            HammersteinWiener(4, 5, 6, None, "dead_zone"),
            structures.hammerstein_wiener(4, 5, 6, output="dead_zone", offset="free"),
        ),
        (OutputError(4, 5, 6), structures.output_error(4, 5, 6, offset="free")),
        (OutputError(4, 5, 6, "none"), structures.output_error(4, 5, 6)),
        (Wiener(4, 5, 6, "dead_zone"), structures.wiener(4, 5, 6, "dead_zone", offset="free")),
        (WienerHammerstein(4, 5, 6), structures.wiener_hammerstein(4, 5, 6)),
        (NonlinearArx(4, 5, 6, "simulation"), structures.nlarx(4, 5, 6, focus="simulation")),
        (ActuatedJoint("dead_zone"), structures.actuated_joint("dead_zone", play=False)),
        (
            ActuatedJoint(None, "dead_zone", 0.2),
            structures.actuated_joint(None, sensor="dead_zone", driver_step=0.2, play=False),
        ),
        (ServoJoint(), structures.servo_joint(play=False)),
        (
            ServoJoint("pd", turn=360.0, kp=3.0, limit=7.4),
            structures.servo_joint(
                ServoMotor(load=0, periodic=1, period=360.0, stops=False, at=0.0, loop="pd"),
                play=False,
                limit=7.4,
                fixed={"motor.kp": 3.0},
            ),
        ),
    ):
        assert found.model() == expected


def test_words_for_people():
    wiener = HammersteinWiener(2, 3, 1, None, "dead_zone")
    assert str(wiener) == "hammerstein_wiener (2,3,1) dead_zone"
    assert wiener.short == "hammerstein-wiener (2,3,1)"
    assert wiener.as_subject() == "A Hammerstein-Wiener (nb 2, nf 3, nk 1), output map dead zone model"
    joint = ActuatedJoint("saturation", "polynomial")
    assert joint.short == "actuated-joint"
    assert joint.as_subject().startswith("An actuated joint (motor")
    assert joint.in_words().endswith("driver saturation, sensor polynomial")
    for play in (False, True):
        fit = SimpleNamespace(model=structures.actuated_joint(play=play))
        assert ("linkage, backlash" in joint.as_subject(fit)) == play
    assert OutputError(1, 2, 0).orders == {"nb": 1, "nf": 2, "nk": 0}
