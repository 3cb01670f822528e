# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Profiles of Fast DDS: those of the user take precedence, and the log names them."""

import os
from pathlib import Path

import pytest
from rclpy.context import Context

from lava_ros.ros import middleware
from lava_ros.ros.executor import start_ros
from ros_domain import own_domain

ROOT = Path(__file__).parents[2]
SHIPPED = str(ROOT / 'params/fast_dds.xml')
LOCAL = 'DEFAULT_FASTRTPS_PROFILES.xml'
OLD, NEW = middleware.PROFILES


@pytest.mark.parametrize(('given', 'file', 'used'), [
    ({}, None, ''),
    ({OLD: 'mine.xml'}, 'mine.xml', f'{OLD}=mine.xml'),
    ({NEW: 'mine.xml'}, 'mine.xml', f'{NEW}=mine.xml (only for Fast DDS 3)'),
    ({OLD: 'mine.xml'}, None, f'{OLD}=mine.xml; mine.xml: no such file'),
    ({OLD: ''}, None, f'{OLD}='),
    ({}, LOCAL, LOCAL),
    ({'SKIP_DEFAULT_XML_FILE': '1'}, LOCAL, ''),
])
def test_profiles_of_the_user_take_precedence(monkeypatch, tmp_path, given, file, used):
    monkeypatch.setattr(os, 'environ', dict(given))
    monkeypatch.chdir(tmp_path)
    if file is not None:
        (tmp_path / file).write_text('<profiles/>', encoding='utf-8')
    context = Context()
    start_ros([], context=context, domain_id=own_domain())
    context.shutdown()
    assert os.environ == (given if used else {**given, OLD: SHIPPED})
    text, is_found = middleware.described()
    assert text.startswith('middleware: rmw_fastrtps_cpp, publication mode SYNCHRONOUS, profiles ')
    if used:
        assert f'profiles of the user instead of {SHIPPED}: ' in text
        assert text.endswith(used)
    else:
        assert text.endswith(f'profiles {SHIPPED}')
    assert is_found == ('no such file' not in used)


def test_other_middleware_gets_no_profiles(monkeypatch):
    monkeypatch.setattr(os, 'environ', {})
    name = 'rmw_cyclonedds_cpp'
    monkeypatch.setattr(middleware, 'get_rmw_implementation_identifier', lambda: name)
    middleware.set_profiles()
    assert os.environ == {}
    assert middleware.described() == (f'middleware: {name}', True)


@pytest.mark.parametrize('mode', ['', 'SYNCHRONOUS'])
def test_log_of_the_node_names_profiles_and_publication_mode(graph, monkeypatch, mode):
    profiles = graph.directory / 'mine.xml'
    profiles.write_text((ROOT / 'params/fast_dds.xml').read_text('utf-8'), encoding='utf-8')
    monkeypatch.setenv(OLD, str(profiles)) if mode else monkeypatch.delenv(OLD, raising=False)
    monkeypatch.setenv(middleware.PUBLICATION_MODE, mode) if mode else monkeypatch.delenv(
        middleware.PUBLICATION_MODE, raising=False
    )
    node = graph.node(device='cpu')
    node.wait_for_log(f'publication mode {mode or "ASYNCHRONOUS"}, profiles')
    used = f'of the user instead of {SHIPPED}: {OLD}={profiles}' if mode else SHIPPED
    assert f'profiles {used}' in node.log
