# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A process that asks a node for things, one JSON line at a time; each is answered with one.

{"change": TRANSITION} asks for a transition by its name, {"state": true} for the state,
{"names": NAMES} for what the node has in the graph, {"call": SERVICE, "data": BOOL} calls a
service, {"set": {NAME: VALUE}} sets parameters. ``"node"`` says which, /lava without.
"""

import json
import sys
import time

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import SetParametersAtomically
import rclpy
from rclpy.node import NodeNameNonExistentError
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

#: How long to wait for an answer, on a busy machine too [s].
PATIENCE = 60.0

TRANSITIONS = {
    'configure': Transition.TRANSITION_CONFIGURE,
    'activate': Transition.TRANSITION_ACTIVATE,
    'deactivate': Transition.TRANSITION_DEACTIVATE,
    'cleanup': Transition.TRANSITION_CLEANUP,
}


class Asker:
    """Calls services of nodes and returns what they answer."""

    def __init__(self):
        """Join the graph."""
        self._node = rclpy.create_node('test_client')
        self._clients = {}

    def call(self, kind, name, request):
        """Call a service."""
        if name not in self._clients:
            self._clients[name] = self._node.create_client(kind, name)
        client = self._clients[name]
        if not client.wait_for_service(timeout_sec=PATIENCE):
            raise TimeoutError(f'no service {name}')
        future = client.call_async(request)
        rclpy.spin_until_future_complete(self._node, future, timeout_sec=PATIENCE)
        if not future.done():
            raise TimeoutError(f'no answer from {name}')
        return future.result()

    def change(self, node, name):
        """Ask for a transition: ``shutdown`` is another in each state, and found by its label."""
        transition = Transition(id=TRANSITIONS.get(name, 0))
        transition.label = '' if name in TRANSITIONS else name
        request = ChangeState.Request(transition=transition)
        return self.call(ChangeState, f'{node}/change_state', request).success

    def state(self, node):
        """The label of the state."""
        return self.call(GetState, f'{node}/get_state', GetState.Request()).current_state.label

    def names(self, node, expected):
        """Topics and services of a node, sorted, once they are as expected or change no more.

        Without any that are expected they have to stay for two seconds: a busy machine learns of
        them one by one.
        """
        space, _, name = node.rpartition('/')
        ways = (
            self._node.get_publisher_names_and_types_by_node,
            self._node.get_subscriber_names_and_types_by_node,
            self._node.get_service_names_and_types_by_node,
        )
        found, since, end = [], 0.0, time.monotonic() + PATIENCE
        while found != expected and time.monotonic() < end:
            time.sleep(0.1)
            before = found
            try:
                found = sorted({item for way in ways for item, _ in way(name, space or '/')})
            except NodeNameNonExistentError:
                found = []
            since = since if found == before else time.monotonic()
            if not expected and f'{node}/get_state' in found and time.monotonic() - since > 2.0:
                break
        return found

    def set(self, node, values):
        """Set parameters together."""
        request = SetParametersAtomically.Request()
        request.parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        name = f'{node}/set_parameters_atomically'
        result = self.call(SetParametersAtomically, name, request).result
        return {'success': result.successful, 'message': result.reason}

    def service(self, node, name, data):
        """Call one of the node's own services."""
        kind = Trigger if data is None else SetBool
        request = kind.Request() if data is None else kind.Request(data=data)
        result = self.call(kind, f'{node}/{name}', request)
        return {'success': result.success, 'message': result.message}

    def answer(self, order):
        """Do what a line asks for."""
        node = order.get('node', '/lava')
        if 'change' in order:
            return self.change(node, order['change'])
        if 'state' in order:
            return self.state(node)
        if 'names' in order:
            return self.names(node, order['names'])
        if 'set' in order:
            return self.set(node, order['set'])
        return self.service(node, order['call'], order['data'])


def main():
    """Answer lines until there are no more."""
    rclpy.init()
    asker = Asker()
    for line in sys.stdin:
        print(json.dumps(asker.answer(json.loads(line))), flush=True)


if __name__ == '__main__':
    main()
