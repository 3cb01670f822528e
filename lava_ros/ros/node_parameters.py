# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameters of an rclpy node: declaration, types, and changes."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from difflib import get_close_matches
from itertools import pairwise
import re
from typing import Any

from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterNotDeclaredException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from lava_ros.errors import LavaError, RefusalError
from lava_ros.files.yaml import read_yaml
from lava_ros.ros.parameters import ParameterSpec
from lava_ros.ros.rclpy_internals import parameter_overrides, set_read_only
from lava_ros.scene import Vent

#: Values that stand for an empty list of strings: ROS leaves a parameter unset that is an empty
#: list at the start, ``ros2 param dump`` writes it as null, and ROS reads null as a string.
_EMPTY_LISTS = (None, '', '~', 'null', 'Null', 'NULL', 'None')


def declare(node: Node, specs: tuple[ParameterSpec, ...]) -> dict[str, Any]:
    """Declare parameters that a node does not have yet.

    Returns:
        Values of all ``specs`` by name.

    Raises:
        LavaError: If a value that was given at the start has another type or is out of range.
    """
    given = parameter_overrides(node)
    for spec in specs:
        if not node.has_parameter(spec.name):
            value = given.get(spec.name)
            try:
                node.declare_parameter(
                    spec.name,
                    spec.default,
                    spec.descriptor(),
                    ignore_override=spec.is_list and _is_empty(value),
                )
            except InvalidParameterTypeException:
                expected = f'a {spec.type_name}'
                if isinstance(spec.default, float):
                    expected += '; write a whole number as 5.0'
                raise LavaError(spec.name, value, expected) from None
            except InvalidParameterValueException:
                raise LavaError(spec.name, value, spec.range_text) from None
    return {spec.name: plain(node.get_parameter(spec.name).value) for spec in specs}


def _is_empty(value: Any) -> bool:
    if value is None or isinstance(value, str):
        return value in _EMPTY_LISTS
    return hasattr(value, '__len__') and len(value) == 0


def with_types(node: Node, given: Iterable[Parameter]) -> list[Parameter]:
    """Convert new values to the types of the node's parameters.

    ``ros2 param load`` sends 7e-07 from its own dump as a string, because a YAML number has a
    point, and null as the string None; ``ros2 param set`` sends 60 as a whole number. An empty
    list of strings becomes a list with one empty string, which has a type.

    Raises:
        ParameterNotDeclaredException: If the node does not have one; that of rclpy has no names.
    """
    result = list(given)
    if unknown := [item.name for item in result if not node.has_parameter(item.name)]:
        raise ParameterNotDeclaredException(unknown)
    for index, item in enumerate(result):
        is_list = node.describe_parameter(item.name).dynamic_typing
        is_number = type(item.value) in (str, int)
        if is_list and _is_empty(item.value):
            result[index] = Parameter(item.name, value=[''])
        elif is_number and node.get_parameter(item.name).type_ == Parameter.Type.DOUBLE:
            with suppress(ValueError):
                result[index] = Parameter(item.name, value=float(item.value))
    return result


def typed(args: Sequence[str]) -> set[str]:
    """Return the names of the parameters that a command line sets with ``-p name:=value``."""
    words = [word for flag, word in pairwise(args) if flag in ('-p', '--param')]
    return {word.partition(':=')[0].removeprefix('lava:') for word in words}


def without_effect(node: Node, typed_names: Collection[str]) -> list[str]:
    """Return a warning for each parameter given at the start that the node does not have.

    A parameter file may contain parameters of other nodes, so these are not errors.

    Raises:
        LavaError: If such a parameter is in ``typed_names``, the names on the command line.
    """
    known, given = list(node.get_parameters_by_prefix('')), parameter_overrides(node)
    result = []
    for name in sorted(set(given) - set(known)):
        close = get_close_matches(name, known, 3)
        text = f'; similar names: {", ".join(close)}' if close else ''
        if name.split('.')[0] in ('vent', 'vents', *(item.name for item in fields(Vent))):
            text += '; set vents with the scene file (scene), the topic vents or clicks'
        if name in typed_names:
            problem = f'This node has no parameter {name!r}{text}'
            raise RefusalError(f'-p {name}', problem, 'Correct the name, or leave it out')
        result.append(f'this node has no parameter {name!r}: its value has no effect{text}')
    return result


def without_section(args: Sequence[str], node: str) -> list[str]:
    """Return a warning for each parameter file without a section for a node; ROS ignores it.

    ``args`` are the arguments of the command line, which ROS has accepted; ``node`` is a full
    name.
    """
    result = []
    for path in (word for flag, word in pairwise(args) if flag == '--params-file'):
        names: list[str] = []
        # ROS has read the file
        with suppress(LavaError):
            names = sorted(_sections(read_yaml('--params-file', path)))
        # as in rcl: * matches one part of a name, and ** any number of parts
        patterns = (re.sub(r'/?\*\*|\*', _wildcard, name) for name in names)
        if not any(re.fullmatch(pattern, node) for pattern in patterns):
            result.append(
                f'--params-file {path} has no parameters for {node}, only for '
                f'{", ".join(names) or "no node"}: it has no effect'
            )
    return result


def _wildcard(match: re.Match[str]) -> str:
    return r'(/\w+)*' if '**' in match[0] else r'\w+'


def _sections(tree: Any, name: str = '') -> set[str]:
    """Return the names of nodes in a parameter file, which may be nested by namespace."""
    if not isinstance(tree, Mapping):
        return set()
    found = {name} if 'ros__parameters' in tree else set()
    return found.union(
        *(_sections(item, f'{name}/{str(key).strip("/")}') for key, item in tree.items()
          if key != 'ros__parameters')
    )


def fix(node: Node, specs: Iterable[ParameterSpec], *, fixed: bool) -> None:
    """Make the read-only parameters of a node fixed or settable."""
    for spec in specs:
        if spec.read_only and node.has_parameter(spec.name):
            set_read_only(node, spec.name, fixed)


def put(node: Node, values: Mapping[str, Any]) -> None:
    """Set parameters of a node, all or none.

    Raises:
        LavaError: If a value is refused.
    """
    if not values:
        # rclpy raises for an empty list
        return
    new = [Parameter(name, value=value) for name, value in values.items()]
    result = node.set_parameters_atomically(new)
    if not result.successful:
        problem = f'The parameters {", ".join(values)} cannot be set: {result.reason}'
        raise RefusalError('parameters', problem, 'Choose other values')


def plain(value: Any) -> Any:
    """Return a parameter's value; an array becomes a list."""
    return value if value is None or isinstance(value, str | bool | int | float) else list(value)
