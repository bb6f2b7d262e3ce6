"""What to record so that a parameter can be told."""

_ENDS = "drive the {joint} into both ends at full voltage: qpal simulate --joint {joint} --excitation sweep shows how"
_LEVELS = (
    "let it start often from many low voltages: "
    "qpal simulate --joint {joint} --excitation staircase --set amplitude=7,hold=0.1,steps=120,order=stairs shows how"
)
_STEPS = (
    "record at least 100 samples a second under random levels: "
    "qpal simulate --joint {joint} --excitation aprbs --ts 0.01 shows how"
)
_ADVICE = {
    "retracted_length": _ENDS,
    "stroke": _ENDS,
    "lower": _ENDS,
    "upper": _ENDS,
    "no_load_speed": "drive it at several voltages: qpal simulate --joint {joint} --excitation aprbs shows how",
    "coulomb": _LEVELS,
    "asymmetry": _LEVELS,
    "stribeck": _LEVELS,
    "stribeck_speed": _LEVELS,
    "dead_band": "measure the voltage of the bridge without a motor at a small duty",
    "rotor_inertia": _STEPS,
    "delay": _STEPS,
    "backlash": (
        "let the link cross its backlash, for example with the leg on its side; "
        "with the drive at rest and power off, move the link by hand"
    ),
    "load_friction": "record once more with a known weight on the foot",
    "stall_force": "measure the force of the stalled motor, or record once more with a known weight on the foot",
    "stall_torque": "measure the torque of the stalled motor, or record once more with a known weight on the foot",
}
_ANY = "record the {joint} from end to end, at several voltages, with rests"


def what_to_record(joint: str, row: str) -> str:
    """What to record to tell `row` of `joint`, as the second half of a sentence."""
    return _ADVICE.get(row.rpartition(".")[2], _ANY).format(joint=joint)
