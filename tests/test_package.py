# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Descriptions of the package agree with the package."""

import importlib
import json
from pathlib import Path
import re
import runpy
import shutil
import subprocess
import sys
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

from packaging.requirements import Requirement
import pytest
import yaml

from install import image
import lava_ros
from lava_ros.cli.effects import COSTS
from project import EXTRAS, GROUPS, imported_names, PROJECT, TOOLS

ROOT = Path(__file__).parents[1]

#: Distribution that brings a module, where the names differ.
DISTRIBUTIONS = {
    'PIL': 'pillow', 'mcap_ros2': 'mcap-ros2-support', 'warp': 'warp-lang', 'yaml': 'pyyaml',
}

MANIFEST = ElementTree.parse(ROOT / 'package.xml').getroot()

#: Modules of ROS: package.xml names them, and the extra `ros` brings them all.
ROS_MODULES = {'rclpy', 'rcl_interfaces'}


def _canonical(name: str) -> str:
    return re.sub(r'[-_.]+', '-', name).lower()


#: Lines of constraints.txt by name.
PINS: dict[str, list[Requirement]] = {}
for line in (ROOT / 'constraints.txt').read_text().splitlines():
    if line and not line.startswith('#'):
        PINS.setdefault(_canonical(Requirement(line).name), []).append(Requirement(line))


#: Lines of constraints-jazzy.txt.
JAZZY = [
    Requirement(line) for line in (ROOT / 'constraints-jazzy.txt').read_text().splitlines()
    if not line.startswith('#')
]


def _imported_packages() -> set[str]:
    imports = {name.split('.')[0] for names in imported_names().values() for name in names}
    return imports - {*sys.stdlib_module_names, 'lava_ros'}


def _ros_packages(imports: set[str]) -> set[str]:
    of_ros = {name for name in imports if name.endswith(('_msgs', '_srvs', '_interfaces'))}
    return of_ros | ROS_MODULES & imports


@pytest.fixture(scope='module')
def passed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return the arguments that setup.py passes to setuptools."""
    passed: dict[str, Any] = {}
    stand_in = SimpleNamespace(setup=passed.update, Distribution=object, apply_configuration=None)
    with pytest.MonkeyPatch.context() as patch:
        for name in ('setuptools', 'setuptools.config', 'setuptools.config.pyprojecttoml'):
            patch.setitem(sys.modules, name, stand_in)  # type: ignore[arg-type]
        # colcon runs a link to setup.py in another folder
        place = tmp_path_factory.mktemp('build')
        (place / 'setup.py').symlink_to(ROOT / 'setup.py')
        patch.chdir(place)
        runpy.run_path('setup.py')
    return passed


@pytest.fixture(scope='module')
def installed(passed: dict[str, Any]) -> dict[str, list[str]]:
    """Return the data files that setup.py passes to setuptools."""
    return dict(passed['data_files'])


def test_installed_package_comes_before_a_clone(passed: dict[str, Any]) -> None:
    # the default finder would come after a folder `lava_ros`, such as a clone
    assert passed['options']['editable_wheel'] == {'mode': 'compat'}


#: Prints the attributes that colcon reads and cannot evaluate. It evaluates all others of the
#: distribution and of its metadata (colcon-python-setup-py 0.2.9, `get_setup_information`).
NOT_LITERAL = """
import ast
import setuptools
from distutils.core import run_setup

dist = run_setup('setup.py', script_args=('--dry-run',), stop_after='config')
skipped = {
    'cmdclass', 'distclass', 'ext_modules', 'metadata', 'license_files', 'provides_extras',
    *dist.display_option_names,
}
assert dist.metadata.name == 'lava_ros' and dist.entry_points, 'pyproject.toml is not read'
for owner in (dist, dist.metadata):
    for key, value in vars(owner).items():
        if not (key.startswith('_') or callable(value) or key in skipped):
            try:
                ast.literal_eval(repr(value))
            except (SyntaxError, ValueError):
                print(type(owner).__name__, key, repr(value))
"""


@pytest.mark.parametrize('has_pyproject', [True, False])
def test_colcon_can_evaluate_the_metadata(has_pyproject: bool, tmp_path: Path) -> None:
    # `colcon build --symlink-install` runs a link to setup.py in a folder without pyproject.toml
    (tmp_path / 'setup.py').symlink_to(ROOT / 'setup.py')
    done = subprocess.run(
        [sys.executable, '-c', NOT_LITERAL], cwd=ROOT if has_pyproject else tmp_path,
        capture_output=True, text=True, check=False,
    )
    assert (done.returncode, done.stdout) == (0, ''), done.stderr


def test_name_version_and_contact_agree() -> None:
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text(encoding='utf-8'))
    assert MANIFEST.get('format') == '3'
    assert MANIFEST.findtext('name') == PROJECT['name'] == citation['title'] == 'lava_ros'
    assert MANIFEST.findtext('version') == PROJECT['version'] == lava_ros.__version__
    assert citation['version'] == lava_ros.__version__
    assert MANIFEST.findtext('license') == PROJECT['license']['text'] == 'Apache-2.0'
    assert citation['license'] == 'Apache-2.0'
    maintainer = MANIFEST.find('maintainer')
    assert maintainer is not None
    assert maintainer.get('email') == PROJECT['maintainers'][0]['email']
    assert MANIFEST.findtext('export/build_type') == 'ament_python'


def test_scripts_exist() -> None:
    assert set(PROJECT['scripts']) == {'lava', 'lava_node'}
    for script in PROJECT['scripts'].values():
        module, function = script.split(':')
        assert callable(getattr(importlib.import_module(module), function))


def test_ros2_run_finds_the_commands(tmp_path: Path) -> None:
    folders = [tmp_path / 'bin', tmp_path / 'lib/lava_ros']
    for folder in folders:
        folder.mkdir(parents=True)
    for name in ('lava', 'lava_node'):
        program = folders[0] / name
        program.write_text('#!/bin/sh\necho "$0" "$$" "$@"\n')
        program.chmod(0o755)
        starter = folders[1] / name
        shutil.copy(ROOT / 'libexec' / name, starter)
        child = subprocess.Popen(
            [starter, '--ros-args', '-p', 'a:=two words'], stdout=subprocess.PIPE, text=True
        )
        output, _ = child.communicate(timeout=120.0)
        path, process, words = output.strip().split(' ', 2)
        assert Path(path).resolve() == program
        assert (int(process), words) == (child.pid, '--ros-args -p a:=two words')


def test_data_files_are_installed(installed: dict[str, list[str]]) -> None:
    assert installed['share/ament_index/resource_index/packages'] == ['resource/lava_ros']
    assert installed['share/lava_ros'] == ['package.xml']
    assert 'msg_configs/default.yaml' in installed['share/lava_ros/msg_configs']
    assert any(name.endswith('.launch.py') for name in installed['share/lava_ros/launch'])
    assert installed['share/lava_ros/docs/benchmarks'] == [COSTS]
    assert set(installed['lib/lava_ros']) == {'libexec/lava', 'libexec/lava_node'}
    for folder in ('examples', 'foxglove', 'launch', 'msg_configs', 'params', 'rviz', 'schemas'):
        files = {f'{folder}/{path.name}' for path in (ROOT / folder).glob('*') if path.is_file()}
        assert files and set(installed[f'share/lava_ros/{folder}']) == files
    assert all((ROOT / name).is_file() for names in installed.values() for name in names)
    inside = {
        f'{package.replace(".", "/")}/{name}'
        for package, names in TOOLS['setuptools']['package-data'].items()
        for name in names
    }
    paths = [path for path in (ROOT / 'lava_ros').rglob('*') if path.is_file()]
    others = [path for path in paths if path.suffix not in ('.py', '.pyc')]
    assert inside == {path.relative_to(ROOT).as_posix() for path in others}


def test_image_contains_the_package(installed: dict[str, list[str]], tmp_path: Path) -> None:
    found = image.instructions()
    texts: dict[str, list[str]] = {kind: [] for kind, _ in found}
    for kind, text in found:
        texts[kind].append(text)
    assert texts['FROM'] == ['ros:jazzy-ros-base']
    for step in texts['RUN']:
        subprocess.run(['bash', '-nc', step], check=True)
    assert texts['COPY'] == ['. /src']
    extras = re.search(r"'/src\[(.*)\]'", texts['RUN'][-1])
    assert extras and set(extras[1].split(',')) <= set(EXTRAS)
    (entry,) = map(json.loads, texts['ENTRYPOINT'])
    assert entry[-1] in PROJECT['scripts']
    image.copy_context(tmp_path / 'src')
    data = [name for names in installed.values() for name in names]
    modules = [str(path.relative_to(ROOT)) for path in (ROOT / 'lava_ros').rglob('*.py')]
    needed = {*data, *modules, 'setup.py', 'pyproject.toml', 'README.md'}
    assert all((tmp_path / 'src' / name).is_file() for name in needed)
    assert not (tmp_path / 'src/tests').exists()


def test_imported_packages_are_declared() -> None:
    imports = _imported_packages()
    requirements = [*PROJECT['dependencies'], *EXTRAS['all']]
    others = imports - _ros_packages(imports)
    needed = {_canonical(DISTRIBUTIONS.get(name, name)) for name in others}
    assert needed <= {_canonical(Requirement(item).name) for item in requirements}


def test_package_xml_names_what_a_computer_without_screen_needs() -> None:
    launched = {'launch', 'launch_ros', 'ros2launch'}
    declared = {str(item.text) for item in MANIFEST.findall('exec_depend')}
    keys = {name for name in declared if name.startswith('python3-')}
    # imported by the name of its message
    optional = {'tf2_msgs'}
    needed = _ros_packages(_imported_packages()) - {'grid_map_msgs'}
    assert declared - keys == needed | launched | optional
    # pip installs all others
    modules = {key.removeprefix('python3-') for key in keys}
    distributions = {DISTRIBUTIONS.get(name, name) for name in modules}
    assert distributions < {Requirement(item).name for item in PROJECT['dependencies']}
    # pip must not replace those of apt
    assert {requirement.name for requirement in JAZZY} == distributions


def test_installation_with_apt_names_all_requirements() -> None:
    ranges = {item.name: item for item in map(Requirement, PROJECT['dependencies'])}
    for pin in JAZZY:
        (version,) = (bound.version for bound in pin.specifier)
        assert ranges[pin.name].specifier.contains(version), pin
    page = (ROOT / 'docs/install.md').read_text(encoding='utf-8')
    (line,) = re.findall('(?m)^pip install .*colcon-common-extensions (.*)$', page)
    assert set(line.split()) == set(ranges)


def test_requirements_have_lower_bounds_and_pins() -> None:
    required = [*PROJECT['dependencies'], *EXTRAS['all']]
    for item in [*required, *GROUPS['test'], *GROUPS['look']]:
        requirement = Requirement(item)
        # constraints.txt has the versions above which nothing was tested
        assert [bound.operator for bound in requirement.specifier] == ['>='], item
        for pin in PINS[_canonical(requirement.name)]:
            (version,) = (bound.version for bound in pin.specifier)
            assert requirement.specifier.contains(version), (item, version)
    ros = [item for item in required if item.startswith('ros-')]
    assert ros and all(item.startswith('ros-jazzy-') for item in ros)


def test_pins_cover_every_python() -> None:
    always = {'numpy', 'warp-lang', 'mcap', 'rasterio', 'matplotlib', 'ros-rclpy'}
    for version in ('3.10', '3.11', '3.12', '3.13'):
        environment = {'python_version': version}
        for name, lines in PINS.items():
            assert all('==' in str(line.specifier) for line in lines)
            chosen = sum(not one.marker or one.marker.evaluate(environment) for one in lines)
            assert chosen == 1 or (chosen == 0 and name not in always), (name, version)
    assert always <= set(PINS)
