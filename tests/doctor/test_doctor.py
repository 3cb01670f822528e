# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checks of the machine and the ROS graph, and the report of `lava check install`."""

from collections import namedtuple
import importlib.metadata
import json
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

from packaging.requirements import Requirement
import pytest

from command_line import lava
from lava_ros import doctor
from lava_ros.doctor import FAIL, Finding, OK, Results, WARN
from lava_ros.files.resources import share_path
from lava_ros.layers.layer_files import layers_from_dict, load_layers
from project import EXTRAS, PROJECT

Usage = namedtuple('Usage', 'total used free')
Version = namedtuple('Version', 'major minor micro')


def one(check: Results) -> Finding:
    """Return the only finding of a check, which has a remedy unless it is OK."""
    (result,) = check
    found = Finding('check', *result)
    assert found.text
    assert found.remedy or found.level == OK
    return found


@pytest.mark.parametrize(
    ('version', 'level'),
    [((3, 10, 0), OK), ((3, 13, 9), OK), ((3, 14, 0), WARN)],
)
def test_python_version_is_checked(version, level, monkeypatch):
    monkeypatch.setattr(sys, 'version_info', Version(*version))
    assert one(doctor.check_python()).level == level


def test_missing_and_old_packages_are_reported(monkeypatch):
    gis = (f'{item}; extra == "gis"' for item in EXTRAS['gis'])
    requirements = [*PROJECT['dependencies'], *gis]
    versions = {item.name: str(item.specifier)[2:] for item in map(Requirement, requirements)}
    others = ['viser>=1.1; extra == "view"', 'tomli>=2; python_version < "3"']

    def version(name):
        if name not in versions:
            raise importlib.metadata.PackageNotFoundError(name)
        return versions[name]

    monkeypatch.setattr(doctor.importlib.metadata, 'version', version)
    monkeypatch.setattr(
        doctor.importlib.metadata, 'requires', lambda name: [*requirements, *others]
    )
    found = one(doctor.check_packages())
    assert found.level == OK
    assert found.text == ', '.join(f'{name} {version}' for name, version in versions.items())
    del versions['rasterio'], versions['mcap']
    versions['numpy'] = '1.9'
    *bad, good = doctor.check_packages()
    assert good[0] == OK
    assert bad == [
        (FAIL, 'mcap is missing', 'pip install mcap'),
        (FAIL, 'numpy is 1.9, and lava_ros needs >=1.26', 'pip install --upgrade numpy'),
        (WARN, 'rasterio is missing', 'pip install rasterio'),
    ]


def test_requirements_are_unknown_without_an_installation(monkeypatch):
    def requires(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(doctor.importlib.metadata, 'requires', requires)
    assert one(doctor.check_packages()).text == 'lava_ros is not installed'


def warp(count, cache=''):
    """Return a stand-in for Warp with a number of GPUs and a folder of kernels."""
    devices = [
        SimpleNamespace(
            alias=f'cuda:{index}', name='H200', arch=90, free_memory=130e9, total_memory=140e9
        )
        for index in range(count)
    ]
    return SimpleNamespace(
        config=SimpleNamespace(kernel_cache_dir=cache), get_cuda_devices=lambda: devices,
        get_cuda_driver_version=lambda: (12, 8),
    )


def test_gpus_are_listed(monkeypatch):
    monkeypatch.setattr(doctor, '_warp', lambda: warp(2))
    first, second = doctor.check_gpu()
    text = 'cuda:0: H200, sm_90, 130.0 of 140.0 GB free, driver for CUDA 12.8'
    assert first == (OK, text) and second[0] == OK
    monkeypatch.setattr(doctor, '_warp', lambda: warp(0))
    monkeypatch.setattr(doctor.shutil, 'which', lambda name: None)
    monkeypatch.setattr(doctor.Path, 'exists', lambda path: False)
    found = one(doctor.check_gpu())
    assert found.level == WARN and found.text.startswith('none: the simulation runs on the CPU')
    monkeypatch.setattr(doctor.shutil, 'which', lambda name: '/usr/bin/nvidia-smi')
    assert 'cannot use' in one(doctor.check_gpu()).text


def test_exception_of_warp_is_reported(monkeypatch):
    def broken():
        raise RuntimeError('libcuda is too old')

    monkeypatch.setattr(doctor, '_warp', broken)
    for check in (doctor.check_gpu, doctor.check_kernel_cache):
        found = one(check())
        assert found.level == FAIL
        assert 'libcuda is too old' in found.text


def test_kernel_cache_is_measured(tmp_path, monkeypatch):
    (tmp_path / 'module').mkdir()
    (tmp_path / 'module/kernels.o').write_bytes(bytes(3_000_000))
    monkeypatch.setattr(doctor, '_warp', lambda: warp(0, str(tmp_path)))
    found = one(doctor.check_kernel_cache())
    assert (found.level, found.text) == (OK, f'{tmp_path}, 3 MB')
    monkeypatch.setattr(doctor, '_warp', lambda: warp(0, '/proc/none'))
    found = one(doctor.check_kernel_cache())
    assert found.level == FAIL
    assert 'WARP_CACHE_PATH' in found.remedy


@pytest.mark.parametrize(
    ('free', 'level'), [(5 * 10**8, FAIL), (5 * 10**9, WARN), (5 * 10**11, OK)]
)
def test_free_space_is_checked(free, level, tmp_path, monkeypatch):
    monkeypatch.setattr(doctor.shutil, 'disk_usage', lambda path: Usage(10**12, 0, free))
    found = one(doctor.check_disk(tmp_path / 'none/yet'))
    assert found.level == level
    assert f'{free / 1e9:.1f} GB' in found.text
    assert not (tmp_path / 'none').exists()
    found = one(doctor.check_disk('/proc/bags'))
    assert found.level == FAIL
    assert '/proc/bags cannot be written (' in found.text


@pytest.mark.parametrize(('state', 'level', 'words'), [
    ((0, 3000), OK, 'synchronised within 3 ms'),
    ((0x40, 3000), WARN, 'not synchronised'),
    # synchronised, but with a large error
    ((0, 16_000_000), WARN, 'not synchronised'),
    # a C library without adjtimex
    (None, WARN, 'its state is unknown'),
])
def test_synchronisation_of_the_clock_is_checked(state, level, words, monkeypatch):
    assert one(doctor.check_clock()).level in (OK, WARN)

    def adjtimex(timex: Any) -> int:
        doctor.ctypes.c_int.from_buffer(timex, doctor._TIMEX_STATUS).value = state[0]
        doctor.ctypes.c_long.from_buffer(timex, doctor._TIMEX_MAXERROR).value = state[1]
        return 0

    library = SimpleNamespace(adjtimex=adjtimex) if state else object()
    monkeypatch.setattr(doctor.ctypes, 'CDLL', lambda *args, **options: library)
    found = one(doctor.check_clock())
    assert (found.level, found.text) == (level, words)


def test_ros_distribution_is_checked(monkeypatch):
    assert 'jazzy from wheels' in one(doctor.check_ros({})).text
    sourced = {'AMENT_PREFIX_PATH': '/opt/ros/jazzy', 'ROS_DISTRO': 'jazzy'}
    assert 'jazzy from an installation' in one(doctor.check_ros(sourced)).text
    found = one(doctor.check_ros({'ROS_DISTRO': 'humble'}))
    assert (found.level, found.text) == (WARN, 'ROS_DISTRO is humble')
    monkeypatch.setattr(doctor, 'find_spec', lambda name: None)
    found = one(doctor.check_ros({}))
    assert found.level == FAIL
    assert "pip install '.[ros]'" in found.remedy


@pytest.mark.parametrize(('environment', 'level', 'words'), [
    ({}, OK, 'domain 0, range SUBNET: every machine in the subnet'),
    ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}, OK, 'only this machine'),
    ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}, FAIL, 'no machine'),
    (
        {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF', 'ROS_STATIC_PEERS': '10.0.0.7'},
        OK,
        'no machine, and 10.0.0.7',
    ),
    ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'localhost'}, FAIL, 'no such range'),
    ({'ROS_DOMAIN_ID': '300'}, FAIL, "ROS_DOMAIN_ID is '300'"),
    ({'ROS_DOMAIN_ID': 'five'}, FAIL, "ROS_DOMAIN_ID is 'five'"),
])
def test_discovery_settings_are_checked(environment, level, words):
    found = one(doctor.check_discovery(environment))
    assert found.level == level
    assert words in found.text


def test_discovery_warns_of_ports_that_other_programs_may_use():
    ports, rest = doctor.check_discovery({'ROS_DOMAIN_ID': '150'})
    assert (ports[0], rest[0]) == (WARN, OK) and 'domain 150' in ports[1]


@pytest.mark.parametrize('name', ['default', 'monitoring', 'nav2_keepout', 'nav2_speed'])
def test_layers_of_the_package_reach_robots(name):
    layers = load_layers(share_path(f'msg_configs/{name}.yaml'))
    assert one(doctor.check_qos(layers)).level == OK


def test_layers_with_a_weak_policy_are_reported():
    layer = {
        'source': 'hazard',
        'message': 'nav_msgs/OccupancyGrid',
        'qos': {'reliability': 'best_effort', 'durability': 'volatile'},
    }
    hidden = {**layer, 'enabled': False}
    image = {'source': 'thickness', 'message': 'sensor_msgs/Image', 'qos': layer['qos']}
    layers = layers_from_dict({'layers': {'mask': layer, 'hidden': hidden, 'raw': image}})
    levels, texts, ways_out = zip(*doctor.check_qos(layers), strict=True)
    assert levels == (WARN,) * 2 * len(doctor.CONSUMERS)
    assert all('receive mask' in text for text in texts)
    assert set(ways_out) == {
        'set layers.mask.qos.reliability to reliable',
        'set layers.mask.qos.durability to transient_local',
    }


def test_round_trip_is_timed():
    found = one(doctor.check_round_trip())
    assert found.level in (OK, WARN), found.text
    assert found.text.startswith('rmw_fastrtps_cpp: found after ')
    assert ' ms, there in ' in found.text


def test_middleware_that_cannot_start_is_reported(monkeypatch):
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_of_nobody')
    found = one(doctor.check_round_trip())
    assert found.level == FAIL
    assert 'rmw_of_nobody' in found.text
    monkeypatch.setattr(doctor, 'find_spec', lambda name: None)
    assert one(doctor.check_round_trip()).text == 'not tested: rclpy is not installed'


@pytest.mark.parametrize(('code', 'words'), [
    ('import time; time.sleep(60)', 'no message returned within 0.5 s'),
    ('import os; os.abort()', 'ended with status -6'),
    ('print("""{"error": "a latched message did not arrive within 20 s"}""")', 'latched'),
])
def test_middleware_that_hangs_or_crashes_is_reported(code, words, monkeypatch):
    run = subprocess.run
    monkeypatch.setattr(
        doctor.subprocess, 'run',
        lambda command, **options: run([sys.executable, '-c', code], **options),
    )
    found = one(doctor.check_round_trip(timeout=0.5 if 'sleep' in code else 20.0))
    assert found.level == FAIL
    assert words in found.text


@pytest.fixture
def findings(monkeypatch):
    """Replace the doctor's checks by a list of findings that a test fills."""
    found: list[Finding] = []
    monkeypatch.setattr('lava_ros.cli.install._findings', lambda args: iter(found))
    return found


def test_findings_are_lines(findings):
    findings += [Finding('python', OK, '3.11'), Finding('gpu', WARN, 'none [x]', 'buy one')]
    lines = ['OK    python        3.11', 'WARN  gpu           none [x]', f'{"":20}-> buy one', '']
    assert lava('check', 'install') == (0, '\n'.join(lines), '')
    # a FAIL sets the exit status
    findings.append(Finding('dds', FAIL, 'nothing came back', 'see the firewall'))
    status, output, _ = lava('check', 'install')
    assert status == 1 and 'FAIL' in output


def test_findings_are_written_as_json(findings, tmp_path):
    findings += [Finding('disk', WARN, '2.0 GB', 'make room')]
    found = [{'check': 'disk', 'level': 'WARN', 'text': '2.0 GB', 'remedy': 'make room'}]
    path = tmp_path / 'doctor.json'
    assert lava('check', 'install', '--json', path) == (0, '', '')
    assert json.loads(path.read_text())['checks'] == found
    status, output, _ = lava('check', 'install', '--json', '-')
    assert status == 0 and json.loads(output)['checks'] == found
    status, _, output = lava('check', 'install', '--json', tmp_path / 'no/such')
    assert status == 2 and '--json' in output


def test_every_check_runs_without_ros(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(doctor, 'find_spec', lambda name: None)
    for name in ('rclpy', 'nav_msgs', 'diagnostic_msgs'):
        monkeypatch.setitem(sys.modules, name, None)
    status, output, errors = lava('check', 'install', '--json', '-', '--msg-config', 'none.yaml')
    assert status == 1, errors
    levels = {item['check']: item for item in json.loads(output)['checks']}
    names = 'python packages ros discovery dds qos gpu kernel_cache disk clock'
    assert set(levels) == {name.replace('_', ' ') for name in names.split()}
    assert levels['ros']['level'] == levels['dds']['level'] == FAIL
    assert 'none.yaml' in levels['qos']['text']
    assert all(item['remedy'] for item in levels.values() if item['level'] != OK)
