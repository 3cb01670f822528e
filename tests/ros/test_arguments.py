# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Mistakes in ROS arguments give one sentence and the exit status of a usage error."""

from pathlib import Path
from unittest.mock import Mock

import pytest
from rclpy.context import Context
from rclpy.node import Node

from command_line import lava
from lava_ros.cli.parser import COMMANDS
from lava_ros.errors import LavaError
from lava_ros.ros import node_parameters
from lava_ros.ros.executor import start_ros
from lava_ros.ros.runtime import NodeRuntime
from ros_domain import own_domain

ROOT = Path(__file__).parents[2]
BAG = ROOT / 'bags/sample'

FILES = {
    'null.yaml': '/**: {ros__parameters: {scene: }}',
    'typo.yaml': '/**: {ros_parameters: {preset: draft}}',
    'flat.yaml': 'preset: draft',
    'open.yaml': '/**: {ros__parameters: {preset: [draft}}',
    'mixed.yaml': '/**: {ros__parameters: {layers_on: [a, 1]}}',
    'type.yaml': '/**: {ros__parameters: {preset: 3}}',
    'whole.yaml': '/lava: {ros__parameters: {time_scale: 60}}',
    'list.yaml': '/**: {ros__parameters: {effects_off: 3}}',
    'unknown.yaml': '/**: {ros__parameters: {discharge: 6., time_scales: 2., qos_overrides.a: 1}}',
}

MISTAKES = {
    ('--params-file', 'nofile.yaml'): "--params-file is 'nofile.yaml', expected a file of",
    ('--params-file', '.'): "--params-file is '.', expected a file of parameters",
    ('--params-file', 'null.yaml'): "--params-file is 'null.yaml', expected a file of parameters",
    ('--params-file', 'typo.yaml'): "--params-file is 'typo.yaml', expected a file of parameters",
    ('--params-file', 'flat.yaml'): "--params-file is 'flat.yaml', expected a file of parameters",
    ('--params-file', 'open.yaml'): "--params-file is 'open.yaml', expected a file of parameters",
    ('--params-file', 'mixed.yaml'): "--params-file is 'mixed.yaml', expected a file of param",
    ('--params-file', 'type.yaml'): 'preset is 3, expected a string',
    ('--params-file', 'whole.yaml'): 'time_scale is 60, expected a double; write a whole number',
    ('--params-file', 'list.yaml'): 'effects_off is 3, expected a list of effects',
    ('--params-file',): '--params-file is missing, expected a value after it',
    ('-r', '__ns:=/fleet-1'): "-r is '__ns:=/fleet-1', expected FROM:=TO, __ns:=/NAMESPACE",
    ('-r', '__ns:=fleet'): "-r is '__ns:=fleet', expected FROM:=TO, __ns:=/NAMESPACE",
    ('-r', '__node:=my-node'): "-r is '__node:=my-node', expected FROM:=TO",
    ('-r', 'hazard'): "-r is 'hazard', expected FROM:=TO",
    ('--remap', 'hazard:=a//b'): "--remap is 'hazard:=a//b', expected FROM:=TO",
    ('-r',): '-r is missing, expected a value after it',
    ('--log-level', 'loud'): "--log-level is 'loud', expected debug, info, warn",
    ('--log-level', 'lava:=loud'): "--log-level is 'lava:=loud', expected debug, info, warn",
    ('--log-level',): '--log-level is missing, expected a value after it',
    ('--enclave', 'here'): "ROS is \"Enclave name is not valid: 'context name must be absolute",
    ('--unknown',): "--ros-args is '--unknown', expected ROS flags",
    ('word',): "--ros-args is 'word', expected ROS flags",
    ('--', 'word'): "an argument is 'word', expected --ros-args",
    ('-p',): '-p is missing, expected a value after it',
    ('-p', 'scene'): "-p is 'scene', expected NAME:=VALUE",
    ('-p', 'scene:='): "-p is 'scene:=', expected NAME:=VALUE; an empty text is written NAME:=",
    ('-p', 'scene:=['): "-p is 'scene:=[', expected NAME:=VALUE",
    ('-p', 'time_scale:=fast'): "time_scale is 'fast', expected a double",
    ('-p', 'time_scale:=1e9'): 'time_scale is 1000000000.0, expected 0.001 to 1000000',
    ('-p', 'time_scale:=-5.0'): 'time_scale is -5.0, expected 0.001 to 1000000',
    ('-p', 'max_vents:=-1'): 'max_vents is -1, expected 0 to 100000',
    ('-p', 'autostart:=3'): 'autostart is 3, expected a bool',
    ('-p', 'use_sim_time:=3'): "Trying to set parameter 'use_sim_time' to '3'",
    ('-p', 'layers_on:=3'): 'layers_on is 3, expected a list of layers',
    ('-p', 'discharge:=60.0'): (
        "This node has no parameter 'discharge'; similar names: default_discharge; set vents with "
        'the scene file'
    ),
    ('-p', 'layers_on:=[points]'): "layers_on is 'points', expected one of height, temp",
    ('-p', 'scene:=nothing.yaml'): "scene is 'nothing.yaml', expected ",
}


@pytest.fixture
def run(run_program, tmp_path):
    """Run the node's program where there are files of parameters."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding='utf-8')
    return run_program


@pytest.mark.parametrize('words', MISTAKES, ids=' '.join)
def test_mistake_is_one_sentence_and_status_2(run, words):
    status, stderr = run('--ros-args', *words)
    (sentence,) = stderr.splitlines()
    assert sentence.startswith(f'lava_node cannot start: {MISTAKES[words]}')
    assert status == 2


def test_unexpected_error_is_the_last_line_after_warnings_of_parameters(run, monkeypatch):
    monkeypatch.setattr(NodeRuntime, '_begin', Mock(side_effect=RuntimeError('went wrong')))
    words = ('-p', 'device:=cpu', '--params-file', 'unknown.yaml')
    status, stderr = run('--ros-args', *words)
    assert stderr.splitlines()[-1] == 'lava_node cannot start: RuntimeError: went wrong'
    assert status == 1
    warnings = [line for line in stderr.splitlines() if 'has no effect' in line]
    assert all('[WARN]' in line for line in warnings)
    discharge, qos, scale = warnings
    assert "this node has no parameter 'discharge'" in discharge
    assert 'similar names: default_discharge; set vents with the scene file (scene)' in discharge
    assert "'time_scales'" in scale and 'vents' not in scale
    assert 'similar names: time_scale' in scale
    assert qos.endswith("no parameter 'qos_overrides.a': its value has no effect")


@pytest.mark.parametrize('node', ['/lava', '/etna/lava', '/etna/north/lava'])
@pytest.mark.parametrize(
    'sections',
    [
        '/**', 'lava', '/lava', 'lava_node', '/etna/lava', 'etna/lava', '/*/lava', '/*/*',
        '/**/lava', '/etna/**', '/etna/*/lava', 'etna: {lava', '/etna: {north/lava',
        'etna: {north: {lava',
    ],
)
def test_parameter_files_of_other_nodes_are_reported(tmp_path, node, sections):
    file, depth = tmp_path / 'file.yaml', sections.count('{')
    file.write_text(f'{sections}: {{ros__parameters: {{mine: 1}}}}{"}" * depth}')
    words = ['--ros-args', '--params-file', str(file)]
    context, (space, name) = Context(), node.rsplit('/', 1)
    context.init(args=words, domain_id=own_domain())
    made = Node(
        name, namespace=space, context=context, start_parameter_services=False,
        automatically_declare_parameters_from_overrides=True,
    )
    warnings = node_parameters.without_section(words, node)
    assert len(warnings) == (not made.has_parameter('mine'))
    assert all(f'no parameters for {node}, only for ' in text for text in warnings)
    made.destroy_node()
    context.shutdown()


@pytest.mark.parametrize('words', [('--help',), ('scene.yaml',), ('-r', '__node:=other')])
def test_rejects_words_outside_ros_args(run, words):
    status, stderr = run(*words)
    assert stderr.splitlines()[-1].startswith(
        f'lava_node cannot start: an argument is {words[0]!r}, expected --ros-args'
    )
    assert status == 2


@pytest.mark.parametrize('command', [name for name in COMMANDS if name != 'ros node'])
def test_other_commands_reject_ros_arguments(command):
    status, out, err = lava(command, '--ros-args', '-r', '__ns:=/fleet-1')
    assert (status, out) == (2, '')
    assert err.splitlines()[-1].startswith(('lava: ', f'lava {command}: '))
    assert 'Traceback' not in err


@pytest.mark.parametrize('domain', ['one', '-1', '1.5', '233', '9999'])
def test_rejects_an_invalid_ros_domain_id(monkeypatch, domain):
    monkeypatch.setenv('ROS_DOMAIN_ID', domain)
    with pytest.raises(LavaError, match='^ROS_DOMAIN_ID is .*, expected a whole number from 0 to'):
        start_ros([])
    status, out, err = lava('ros', 'replay', BAG)
    assert (status, out) == (2, '')
    assert err.startswith('lava ros replay: ROS_DOMAIN_ID is ')
