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

"""Everything a node shows of itself in the graph."""

import time

from lifecycle_msgs.srv import GetAvailableTransitions
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python


def endpoints_of(looking, name):
    """Type, reliability and durability by kind and topic, as they are known now."""
    found = {'publishers': {}, 'subscriptions': {}}
    for topic, _ in looking.get_topic_names_and_types():
        for kind, infos in (
            ('publishers', looking.get_publishers_info_by_topic(topic)),
            ('subscriptions', looking.get_subscriptions_info_by_topic(topic)),
        ):
            for info in infos:
                if info.node_name == name:
                    found[kind][topic] = {
                        'type': info.topic_type,
                        'reliability': info.qos_profile.reliability.name,
                        'durability': info.qos_profile.durability.name,
                    }
    return found


def call(looking, kind, name, **fields):
    """Call a service and return its answer."""
    client = looking.create_client(kind, name)
    assert client.wait_for_service(timeout_sec=60.0), name
    future = client.call_async(kind.Request(**fields))
    executor = SingleThreadedExecutor(context=looking.context)
    executor.add_node(looking)
    executor.spin_until_future_complete(future, timeout_sec=60.0)
    executor.shutdown()
    assert future.done(), name
    return future.result()


def parameters_of(looking, name):
    """Value and description of each parameter, by its name."""
    names = call(looking, ListParameters, f'/{name}/list_parameters').result.names
    values = call(looking, GetParameters, f'/{name}/get_parameters', names=names).values
    shown = call(looking, DescribeParameters, f'/{name}/describe_parameters', names=names)
    found = {}
    for item, value, descriptor in zip(names, values, shown.descriptors, strict=True):
        limits = [*descriptor.floating_point_range, *descriptor.integer_range]
        found[item] = {
            'type': Parameter.Type(value.type).name.lower(),
            'value': parameter_value_to_python(value),
            'read_only': descriptor.read_only,
            'description': descriptor.description,
            'range': [limits[0].from_value, limits[0].to_value] if limits else None,
        }
    return found


def transitions_of(looking, name):
    """Label and states of each transition."""
    answer = call(looking, GetAvailableTransitions, f'/{name}/get_transition_graph')
    return sorted(
        [item.transition.label, item.start_state.label, item.goal_state.label]
        for item in answer.available_transitions
    )


def contract_of(name, domain):
    """What a node in a domain has once that has stopped changing."""
    context = Context()
    context.init(args=[], domain_id=domain)
    try:
        looking = Node('test_looking_at_the_contract', context=context)
        end = time.monotonic() + 60.0
        # a busy machine learns of them one by one: for two seconds nothing has come
        seen = []
        while len(seen) < 5 or not seen[-1][0]['publishers'] or seen[-1] != seen[-5]:
            assert time.monotonic() < end, f'nothing steady of {name}: {seen[-1:]}'
            time.sleep(0.5)
            there = name in looking.get_node_names()
            services, clients = (
                get(name, '/') if there else []
                for get in (
                    looking.get_service_names_and_types_by_node,
                    looking.get_client_names_and_types_by_node,
                )
            )
            seen.append((endpoints_of(looking, name), services, clients))
        endpoints, services, clients = seen[-1]
        found = {
            **endpoints,
            'services': dict(services),
            'clients': dict(clients),
            'parameters': parameters_of(looking, name),
            'transitions': transitions_of(looking, name),
        }
        looking.destroy_node()
        return found
    finally:
        context.shutdown()
