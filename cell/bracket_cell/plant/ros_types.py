"""Messages of ROS 2 for DDS, made from their definitions: no ROS is installed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from types import new_class
from typing import Any

from bracket_cell.packages import needed

PACKAGE_OF = "a topic of ROS 2"


@cache
def message(name: str) -> Any:
    """The class of a message, for example of "sensor_msgs/msg/JointState"; its fields are those of the definition.

    Its name on the wire is that of rmw: `sensor_msgs::msg::dds_::JointState_`.

    Raises:
        InputError: the extra ros2 is not installed.
    """
    idl = needed("cyclonedds.idl", PACKAGE_OF, "ros2")
    package, _, kind = name.split("/")
    fields = {field: _type(of) for field, of in _definitions()[name][1]}

    def body(names: dict[str, Any]) -> None:
        names["__annotations__"] = fields

    made = new_class(kind, (idl.IdlStruct,), {"typename": f"{package}::msg::dds_::{kind}_"}, body)
    return dataclass(made)


@cache
def _definitions() -> dict[str, Any]:
    types = needed("rosbags.typesys", PACKAGE_OF, "ros2")
    return dict(types.get_typestore(types.Stores.ROS2_HUMBLE).fielddefs)


def _type(of: Any) -> Any:
    """The type of a field: a basic one, a message, a sequence or an array of these."""
    types = needed("cyclonedds.idl.types", PACKAGE_OF, "ros2")
    node, told = of
    if node.name == "BASE":
        named: dict[str, Any] = {"string": str, "bool": bool, "byte": types.uint8, "char": types.uint8}
        return named[told[0]] if told[0] in named else getattr(types, told[0])
    if node.name == "NAME":
        return message(told)
    inner, length = _type(told[0]), told[1]
    if node.name == "ARRAY":
        return types.array[inner, length]
    return types.sequence[inner, length] if length else types.sequence[inner]
