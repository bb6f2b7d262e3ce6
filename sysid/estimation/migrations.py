"""Changes between versions of a saved fit: one step per version, so that every old file still loads."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

Names = Mapping[str, str]  # old name -> new name


@dataclass(frozen=True)
class Step:
    """From one version of the file to the next. Renames need a line here and no code; `then` does other changes.

    kinds: kinds of block. fields: the options of a kind of block (by its new name), of 'fit' or of 'model'. parameters:
    the slots of a kind of block, in all parameter names. then: a change of the whole document, after the renames.
    """

    kinds: Names = field(default_factory=dict)
    fields: Mapping[str, Names] = field(default_factory=dict)
    parameters: Mapping[str, Names] = field(default_factory=dict)
    then: Callable[[dict[str, Any]], dict[str, Any]] | None = None

    def apply(self, document: dict[str, Any]) -> dict[str, Any]:
        """The document of this version converted to the next. Unknown parts stay unchanged for the loader."""
        found = _renamed({k: self._blocks(v) for k, v in document.items()}, self.fields.get("fit", {}))
        model = found.get("model")
        if isinstance(model, dict):
            model = _renamed(model, self.fields.get("model", {}))
            found["model"] = model
            names = self._by_parameter(model.get("blocks"), found.get("theta"))
            for table, key in ((found, "theta"), (model, "fixed"), (model, "bounds")):
                if isinstance(table.get(key), dict):
                    table[key] = _renamed(table[key], names)
        return self.then(found) if self.then is not None else found

    def _blocks(self, value: Any) -> Any:
        """The same with every block in it, at any depth, under its new kind and with its new options."""
        if isinstance(value, list):
            return [self._blocks(v) for v in value]
        if not isinstance(value, dict):
            return value
        found = {k: self._blocks(v) for k, v in value.items()}
        if isinstance(found.get("kind"), str):
            found["kind"] = self.kinds.get(found["kind"], found["kind"])
            found = _renamed(found, self.fields.get(found["kind"], {}))
        return found

    def _by_parameter(self, blocks: Any, theta: Any) -> Names:
        """Full names of renamed parameters: 'role.old', of channels 'role.1.old'."""
        found = {}
        for block in (b for b in blocks if isinstance(b, dict)) if isinstance(blocks, list) else ():
            slots = {old: new for kind in _kinds(block) for old, new in self.parameters.get(kind, {}).items()}
            for name in theta if isinstance(theta, dict) else []:
                front, _, slot = name.rpartition(".")
                if slot in slots and (front + ".").startswith(f"{block.get('role')}."):
                    found[name] = f"{front}.{slots[slot]}"
        return found


def _renamed(table: dict[str, Any], names: Names) -> dict[str, Any]:
    return {names.get(k, k): v for k, v in table.items()}


def _kinds(value: Any) -> set[str]:
    """Kinds of block in a value, at any depth."""
    if isinstance(value, list):
        return {kind for v in value for kind in _kinds(v)}
    if not isinstance(value, dict):
        return set()
    own = {value["kind"]} if isinstance(value.get("kind"), str) else set()
    return own | {kind for v in value.values() for kind in _kinds(v)}


# Step k takes version k + 1 to version k + 2; a file goes through all that are newer than it is.
STEPS: tuple[Step, ...] = (
    # Version 1 wrote the loss as mse, which is correct for plain least squares only. It did not store the cost, so its
    # mse is kept; for fits with weights or a robust loss it stays the loss, and so do the criteria that follow from
    # it.
    Step(),
    # Version 2 did not store the offsets that were removed from the estimation data, nor its names, units, fit
    # and noise. They stay unknown (None), and the fit takes every record as it is.
    Step(),
)
VERSION = len(STEPS) + 1


def migrate(document: dict[str, Any], version: int) -> dict[str, Any]:
    """The document of a file of this version in today's form."""
    for step in STEPS[version - 1 :]:
        document = step.apply(document)
    return document
