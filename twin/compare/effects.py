"""The physical effects that a comparison names: their knobs, their words, and the record that shows each best."""

from dataclasses import dataclass

from twin.compare.knobs import DELAY, END_HIGH, END_LOW, SLOPE, ZERO


@dataclass(frozen=True)
class Effect:
    """An effect: `knobs` that it moves (JOINT stands for the joint), words for a sentence, parameters to calibrate.

    `record` are options of `qpal simulate`, which also plan a run on the rig, for a record that shows this effect and
    little else; `why` says what is in it.
    """

    name: str
    words: str
    knobs: tuple[str, ...]
    free: tuple[str, ...]
    record: str
    why: str

    def knobs_of(self, joint: str) -> tuple[str, ...]:
        """Names of the knobs for this joint."""
        return tuple(name.replace("JOINT", joint) for name in self.knobs)

    def free_of(self, joint: str) -> tuple[str, ...]:
        """Names of the twin's parameters that a calibration frees."""
        ends = (
            ("shoulder.lower", "shoulder.upper") if joint == "shoulder" else ("JOINT.retracted_length", "JOINT.stroke")
        )
        names = ends if self.name == "end_stop" else self.free
        return tuple(name.replace("JOINT", joint) for name in names)


TABLE: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        Effect(
            "friction",
            "dry friction",
            ("JOINT.coulomb", "JOINT.asymmetry", "JOINT.stribeck"),
            ("JOINT.coulomb", "JOINT.asymmetry", "JOINT.stribeck"),
            "--excitation staircase --set amplitude=7,hold=0.1,steps=120,order=stairs",
            "slow stairs that start the joint often from low voltages",
        ),
        Effect(
            "backlash",
            "backlash",
            ("JOINT.backlash",),
            ("JOINT.backlash",),
            "--excitation prbs --set amplitude=8",
            "many reversals in the middle of the stroke",
        ),
        Effect(
            "delay",
            "delay",
            (DELAY,),
            ("delay",),
            "--excitation prbs --ts 0.02",
            "fast switching at a short sampling time",
        ),
        Effect(
            "end_stop",
            "end stops",
            (END_LOW, END_HIGH),
            (),
            "--excitation sweep --set jitter=0.5,shrink=0.4",
            "rests at both ends and turns before them",
        ),
        Effect(
            "load",
            "load",
            ("shank_mass", "foot_mass"),
            ("foot_mass",),  # at one joint the two act alike: a calibration can tell one of them
            "--excitation staircase --set amplitude=7,hold=0.1,steps=120,order=stairs",
            "slow motion in both directions over the whole stroke",
        ),
        Effect(
            "supply",
            "supply and speed",
            ("JOINT.rated_voltage", "supply_voltage", "supply_resistance"),
            ("JOINT.rated_voltage", "supply_voltage", "supply_resistance"),
            "--excitation aprbs",
            "many levels between zero and the largest voltage",
        ),
        Effect(
            "sensor",
            "sensor slope and zero",
            (SLOPE, ZERO),
            (),
            "--excitation sweep --set jitter=0.5,shrink=0.4",
            "both ends, and turns before them",
        ),
    )
}
