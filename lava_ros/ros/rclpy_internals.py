# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Functions for which rclpy (Jazzy) has no public interface: they use its private members."""

from collections.abc import Callable
from typing import Any

from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node


def parameter_overrides(node: Node) -> dict[str, Any]:
    """Return the values of parameters that were given at the start, by name."""
    return {name: item.value for name, item in node._parameter_overrides.items()}


def set_read_only(node: Node, name: str, value: bool) -> None:
    """Make a declared parameter read-only or settable; rclpy does not replace its descriptor."""
    node.describe_parameter(name).read_only = value


def guard_change_state(
    node: LifecycleNode, on_unknown: Callable[[Any, str, Any], Any]
) -> None:
    """Reply to a request for a transition that the current state lacks; rclpy would not reply.

    Args:
        node: The node whose service ``change_state`` is guarded.
        on_unknown: Called with the request, the name of the state and the response, which it
            returns.
    """
    service = node._service_change_state
    change_state = service.callback

    def answer(request: Any, response: Any) -> Any:
        try:
            return change_state(request, response)
        except RuntimeError:
            _, state = node._state_machine.current_state
            return on_unknown(request, state, response)

    service.callback = answer
