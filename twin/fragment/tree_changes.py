"""What an edit of an XML tree changed, one sentence an element: a person must see all that happens to their model."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from difflib import SequenceMatcher

_SHOWN = 4  # numbers of an attribute that are shown whole


class Snapshot:
    """The elements of a tree before an edit."""

    def __init__(self, root: ET.Element):
        # The elements are kept, so that no later one gets the identity of one that is taken out.
        self._before = {id(e): (e, _label(parent, e), dict(e.attrib)) for parent, e in _elements(root)}

    def changes(self, root: ET.Element) -> tuple[str, ...]:
        """A sentence for each element that is changed, added or taken out; what is inside of an added one has none.

        An element in place of one with the same name and section counts as a change of it.
        """
        now = list(_elements(root))
        left = {id(e) for _, e in now}
        gone = {label: key for key, (_, label, _) in self._before.items() if key not in left}
        said, added = list[str](), set[int]()
        for parent, element in now:
            key = id(element) if id(element) in self._before else gone.pop(_label(parent, element), None)
            if key is not None:
                was, _, attributes = self._before[key]
                said += _difference(was, attributes, element)
            elif parent is not root:  # whose children are sections
                said += [f"{_named(element)} is added"] if id(parent) not in added else []
                added.add(id(element))
        return *said, *(f"{_named(self._before[key][0])} is taken out" for key in gone.values())


def _elements(root: ET.Element) -> Iterator[tuple[ET.Element, ET.Element]]:
    """Each element with its parent, comments apart."""
    return ((parent, e) for parent in root.iter() for e in parent if isinstance(e.tag, str))


def _label(parent: ET.Element, element: ET.Element) -> tuple[str, str | int]:
    """The name of an element in its section; of one without a name its identity, which no other has."""
    section = parent.tag if parent.tag == "actuator" else element.tag
    return section, element.get("name") or id(element)


def _named(element: ET.Element) -> str:
    joints = [element.attrib[name] for name in ("joint", "joint1", "joint2") if name in element.attrib]
    if name := element.get("name"):
        return f"{element.tag} {name!r}"
    return f"{element.tag} of {' and '.join(map(repr, joints))}" if joints else f"a {element.tag}"


def _difference(was: ET.Element, old: dict[str, str], element: ET.Element) -> list[str]:
    """The change of one element as at most one sentence."""
    new = element.attrib
    parts = [f"is a {element.tag} now"] if was.tag != element.tag else []
    parts += [
        _attribute(name, old.get(name), new.get(name)) for name in {**old, **new} if old.get(name) != new.get(name)
    ]
    return [f"{_named(was)}: {', '.join(parts)}"] if parts else []


def _attribute(name: str, old: str | None, new: str | None) -> str:
    if old is None or new is None:
        return f"{name} {old} is taken out" if new is None else f"{name} {new} is added"
    before, after = old.split(), new.split()
    if max(len(before), len(after)) <= _SHOWN:
        return f"{name} {old} becomes {new}"
    steps = SequenceMatcher(None, before, after, autojunk=False).get_opcodes()
    parts = [_step(before[i:j], after[k:m], k) for what, i, j, k, m in steps if what != "equal"]
    return f"{name} ({len(after)} numbers): {', '.join(parts)}"


def _step(old: list[str], new: list[str], k: int) -> str:
    """One difference of two lists; k is the number of values before it in the new one."""
    if not old:
        return f"{' '.join(new)} is added as number {k + 1}"
    return f"{' '.join(old)} becomes {' '.join(new)} at number {k + 1}" if new else f"{' '.join(old)} is taken out"
