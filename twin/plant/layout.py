"""Offsets of the fields in MuJoCo's C structs that the compiled callbacks read and write."""

import ctypes
from functools import cache

import mujoco
from mujoco.introspect import ast_nodes, structs

_NUMBERS = {
    "int": ctypes.c_int32,
    "float": ctypes.c_float,
    "double": ctypes.c_double,
    "size_t": ctypes.c_size_t,
    "uintptr_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "mjtNum": ctypes.c_double,
    "mjtSize": ctypes.c_int64,
    "mjtBool": ctypes.c_bool,
}


def _c_type(node: object) -> type:
    if isinstance(node, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(node, ast_nodes.ArrayType):
        kind = _c_type(node.inner_type)
        for extent in reversed(node.extents):
            kind = kind * extent
        return kind
    assert isinstance(node, ast_nodes.ValueType), node
    return _NUMBERS[node.name] if node.name in _NUMBERS else _prefix(node.name)


@cache
def _prefix(struct: str, last: str | None = None) -> type[ctypes.Structure]:
    """The ctypes equivalent of MuJoCo's `struct` up to the field `last`, from the declarations in its package."""
    fields: list[tuple[str, type]] = []
    for field in structs.STRUCTS[struct].fields:
        assert isinstance(field, ast_nodes.StructFieldDecl), field
        fields.append((field.name, _c_type(field.type)))
        if field.name == last:
            break
    return type(struct, (ctypes.Structure,), {"_fields_": fields})


@cache
def offset(struct: str, field: str) -> int:
    """Offset [bytes] of `field` in `struct` (mjData, mjModel)."""
    return getattr(_prefix(struct, field), field).offset


def fits() -> bool:
    """Whether the offsets match the running MuJoCo: values read through them equal those of its bindings."""
    model = mujoco.MjModel.from_xml_string(_PROBE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pointers = ("qvel", "ctrl", "userdata", "sensordata", "qfrc_passive", "actuator_moment", "actuator_force", "qacc")
    addresses = {
        name: getattr(data, name).ctypes.data for name in (*pointers, "efc_frictionloss", "efc_force", "ten_length")
    }

    def read(kind: type[ctypes.c_int32] | type[ctypes.c_int64] | type[ctypes.c_size_t], address: int) -> int:
        return kind.from_address(address).value

    same = all(
        read(ctypes.c_size_t, data._address + offset("mjData", name)) == address for name, address in addresses.items()
    )
    counts = [read(ctypes.c_int32, data._address + offset("mjData", name)) for name in ("ne", "nf")]
    users = read(ctypes.c_int64, model._address + offset("mjModel", "nuserdata"))
    return same and counts == [data.ne, data.nf] == [1, 2] and users == model.nuserdata == 5


# Each counted thing in a number of its own, so that two fields that changed places cannot both seem right.
_PROBE = """
<mujoco>
  <size nuserdata="5"/>
  <worldbody>
    <body><joint name="a" frictionloss="1"/><geom size="0.1"/></body>
    <body><joint name="b"/><geom size="0.1"/></body>
  </worldbody>
  <tendon><fixed name="t" frictionloss="1"><joint joint="b" coef="1"/></fixed></tendon>
  <equality><joint joint1="a" polycoef="0.1"/></equality>
  <actuator><motor joint="a"/></actuator>
  <sensor><user dim="1" needstage="acc"/></sensor>
</mujoco>
"""
