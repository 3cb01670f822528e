# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Private members of rclpy: they exist, and a single module uses them."""

import ast
from pathlib import Path
import re

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import pytest
import rclpy
from rclpy.context import Context
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.parameter import Parameter

from lava_ros.ros import rclpy_internals
from ros_domain import own_domain

ROOT = Path(__file__).parents[2]


def trees(folder):
    """Return the syntax trees of Python files by path."""
    return {path: ast.parse(path.read_text(encoding='utf-8')) for path in folder.rglob('*.py')}


def is_private(name):
    return name.startswith('_') and not name.endswith('__')


def assigned(tree):
    """Return the private names that a module defines or sets on its objects."""
    found = set()
    for item in ast.walk(tree):
        if isinstance(item, ast.Attribute) and isinstance(item.ctx, ast.Store):
            found.add(item.attr)
        elif isinstance(item, ast.FunctionDef):
            found.add(item.name)
        elif isinstance(item, ast.Name) and isinstance(item.ctx, ast.Store):
            found.add(item.id)
    return {name for name in found if is_private(name)}


def test_one_module_uses_private_members_of_rclpy():
    known = set().union(*map(assigned, trees(Path(rclpy.__file__).parent).values()))
    assert {'_parameter_overrides', '_state_machine', '_parameters'} <= known
    found = {
        path: tree
        for folder in ('lava_ros', 'launch', 'examples')
        for path, tree in trees(ROOT / folder).items()
    }
    inherited = set().union(*map(assigned, found.values()))
    users = {}
    for path, tree in found.items():
        items = list(ast.walk(tree))
        imports = [item for item in items if isinstance(item, ast.Import | ast.ImportFrom)]
        modules = {getattr(item, 'module', None) or '' for item in imports}
        modules |= {alias.name for item in imports for alias in item.names}
        used = {name for name in modules if re.match(r'rclpy\b.*\.(_|impl\b)', name)}
        for item in items:
            if isinstance(item, ast.Attribute) and is_private(item.attr):
                is_own = isinstance(item.value, ast.Name) and item.value.id == 'self'
                used |= {item.attr} & known - (inherited if is_own else assigned(tree))
        if used and any(name.partition('.')[0] == 'rclpy' for name in modules):
            users[path.relative_to(ROOT).as_posix()] = used
    assert users == {
        'lava_ros/ros/rclpy_internals.py': {
            '_parameter_overrides', '_service_change_state', '_state_machine',
        },
    }


class _Node(LifecycleNode):
    def on_configure(self, state):
        return TransitionCallbackReturn.SUCCESS


@pytest.fixture
def node():
    context = Context()
    context.init(args=[], domain_id=own_domain('internals'))
    result = _Node(
        'private', context=context, use_global_arguments=False, start_parameter_services=False,
        parameter_overrides=[Parameter('given', value=2.5), Parameter('listed', value=['a'])],
    )
    yield result
    result.destroy_node()
    context.shutdown()


def test_parameter_overrides_are_known_before_they_are_declared(node):
    assert rclpy_internals.parameter_overrides(node) == {'given': 2.5, 'listed': ['a']}


def test_parameter_becomes_read_only_and_settable_again(node):
    node.declare_parameter('given', 1.0)
    for is_fixed in (True, False):
        rclpy_internals.set_read_only(node, 'given', is_fixed)
        (result,) = node.set_parameters([Parameter('given', value=3.0)])
        assert result.successful is not is_fixed


def test_unknown_transition_gets_a_reply_with_the_state(node):
    refused = []

    def refuse(request, state, response):
        refused.append((request.transition.id, state))
        response.success = False
        return response

    rclpy_internals.guard_change_state(node, refuse)
    (service,) = [
        item for item in node.services if item.service_name == '/private/change_state'
    ]

    def change(label, number=0):
        request = ChangeState.Request(transition=Transition(id=number, label=label))
        return service.callback(request, ChangeState.Response()).success

    # rclpy itself replies to a label that the state lacks
    assert not change('activate')
    assert not change('', 98)
    assert change('configure')
    assert not change('', 99)
    assert refused == [(98, 'unconfigured'), (99, 'inactive')]
