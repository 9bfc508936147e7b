"""Messages of ROS 2 for DDS, made from their definitions: no ROS is installed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from types import new_class
from typing import Any

from bracket_cell.packages import needed
from bracket_ground.files.files import shipped

PACKAGE_OF = "a topic of ROS 2"
ACTION = "{action}"  # in names of what every action has
DEFINITIONS: dict[str, str] = {
    name: text
    for name, _, text in (
        entry.partition("\n") for entry in shipped("bracket_cell.plant", "messages.msg").read_text().split("MSG: ")[1:]
    )
}  # by name, beside those of the store
OF_ACTIONS = [name.removeprefix(ACTION) for name in DEFINITIONS if name.startswith(ACTION)]
Field = tuple[str, Any]  # a field's name, and its type as the store has it


@cache
def message(name: str, numbered: bool = False) -> Any:
    """The class of a message, for example of "sensor_msgs/msg/JointState"; its fields are those of the definition.

    Its name on the wire is that of rmw: `sensor_msgs::msg::dds_::JointState_`.

    Args:
        numbered: a request or an answer begins with who asked, and the number of the request: rmw_cyclonedds_cpp.

    Raises:
        InputError: the extra ros2 is not installed.
    """
    idl, types = (needed(f"cyclonedds.idl{part}", PACKAGE_OF, "ros2") for part in ("", ".types"))
    package, folder, kind = name.split("/")
    head = {"client_guid": types.uint64, "sequence_number": types.int64} if numbered else {}
    fields = head | {field: _type(of) for field, of in _fields(name)}

    def body(names: dict[str, Any]) -> None:
        names["__annotations__"] = fields

    made = new_class(kind, (idl.IdlStruct,), {"typename": f"{package}::{folder}::dds_::{kind}_"}, body)
    return dataclass(made)


def empty(name: str) -> Any:
    """A message whose numbers are 0 and whose texts and lists are empty."""
    return message(name)(**{field: _empty(of) for field, of in _fields(name)})


def _empty(of: Any) -> Any:
    node, kind = of
    if node.name == "BASE":
        return "" if kind[0] == "string" else False if kind[0] == "bool" else 0
    if node.name == "NAME":
        return empty(_whole(kind))
    return [_empty(kind[0])] * kind[1] if node.name == "ARRAY" else []


@cache
def _store() -> dict[str, list[Field]]:
    types = needed("rosbags.typesys", PACKAGE_OF, "ros2")
    return {name: of[1] for name, of in types.get_typestore(types.Stores.ROS2_HUMBLE).fielddefs.items()}


@cache
def _fields(name: str) -> list[Field]:
    if name not in DEFINITIONS and name in _store():
        return _store()[name]
    types = needed("rosbags.typesys", PACKAGE_OF, "ros2")
    text = DEFINITIONS.get(name)
    if text is None:
        part = next(part for part in OF_ACTIONS if name.endswith(part))
        text = DEFINITIONS[ACTION + part].replace(ACTION, name.removesuffix(part))
    fields: list[Field] = next(iter(types.get_types_from_msg(text, name).values()))[1]
    return fields


def _whole(name: str) -> str:
    """A type's name with its folder."""
    return name if name.count("/") == 2 else name.replace("/", "/msg/", 1)


def _type(of: Any) -> Any:
    """The type of a field: a basic one, a message, a sequence or an array of these."""
    types = needed("cyclonedds.idl.types", PACKAGE_OF, "ros2")
    node, kind = of
    if node.name == "BASE":
        named: dict[str, Any] = {"string": str, "bool": bool, "byte": types.uint8, "char": types.uint8}
        return named[kind[0]] if kind[0] in named else getattr(types, kind[0])
    if node.name == "NAME":
        return message(_whole(kind))
    inner, length = _type(kind[0]), kind[1]
    if node.name == "ARRAY":
        return types.array[inner, length]
    return types.sequence[inner, length] if length else types.sequence[inner]
