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

"""Stand-ins for ``launch`` and ``launch_ros``, which only a full ROS installation has.

Their constructors take what the real ones take, by name; a description is performed with values of
the arguments, and what would be started comes out. They do not show that launch itself reads the
files: a robot's installation does.
"""

from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
import runpy
import sys
from types import ModuleType
from typing import Any

import yaml

ROOT = Path(__file__).parents[2]

#: Where the stand-in FindPackageShare finds packages.
SHARES = {'lava_ros': str(ROOT)}


def perform(value: Any, context: dict[str, str]) -> str:
    """What a substitution, a list of them, or a text comes to."""
    if isinstance(value, (list, tuple)):
        return ''.join(perform(item, context) for item in value)
    return value if isinstance(value, str) else value.perform(context)


@dataclass
class LaunchConfiguration:
    """The value of an argument."""

    variable_name: Any

    def perform(self, context):
        return context[perform(self.variable_name, context)]


@dataclass
class FindPackageShare:
    """The share folder of a package."""

    package: Any

    def perform(self, context):
        return SHARES[perform(self.package, context)]


@dataclass
class ExecutableInPackage:
    """The path of a package's executable."""

    executable: Any
    package: Any

    def perform(self, context):
        package = perform(self.package, context)
        if package in context.get('missing', ''):
            raise LookupError(f"package '{package}' not found")
        return f'{package}:{perform(self.executable, context)}'


@dataclass
class PathJoinSubstitution:
    """Words joined to a path."""

    substitutions: Any

    def perform(self, context):
        return str(Path(*(perform(item, context) for item in self.substitutions)))


@dataclass
class ParameterValue:
    """A parameter with its type."""

    value: Any
    value_type: type | None = None

    def evaluate(self, context):
        # launch takes a plain text for a text
        assert self.value_type is str or not isinstance(self.value, str), self.value
        text = perform(self.value, context)
        return yaml.safe_load(text) if self.value_type is bool else (self.value_type or str)(text)


def _plain(name: str, *needed: str, **optional: Any) -> type:
    """A class of launch that only holds what its constructor takes."""
    fields = [(item, Any, value) for item, value in optional.items()]
    return make_dataclass(name, [*needed, *fields])


ParameterFile = _plain('ParameterFile', 'param_file', allow_substs=False)
DeclareLaunchArgument = _plain(
    'DeclareLaunchArgument', 'name', default_value=None, description=None, choices=None
)
OpaqueFunction = _plain('OpaqueFunction', 'function')
PythonLaunchDescriptionSource = _plain('PythonLaunchDescriptionSource', 'launch_file_path')
IncludeLaunchDescription = _plain(
    'IncludeLaunchDescription', 'launch_description_source', launch_arguments=()
)
LaunchDescription = _plain('LaunchDescription', 'entities')


@dataclass
class Process:
    """What would be started."""

    command: list[str]
    name: str | None = None
    namespace: str = ''
    parameters: dict[str, Any] = field(default_factory=dict)
    files: list[str] = field(default_factory=list)


@dataclass(kw_only=True)
class ExecuteProcess:
    """A process."""

    cmd: Any
    output: str = 'log'

    def start(self, context):
        return Process([perform(word, context) for word in self.cmd])


@dataclass(kw_only=True)
class Node:
    """A process that is a node."""

    package: Any
    executable: Any
    name: Any = None
    namespace: Any = ''
    parameters: Any = ()
    arguments: Any = ()
    remappings: Any = ()
    output: str = 'log'

    def start(self, context):
        words = [f'{perform(self.package, context)}:{perform(self.executable, context)}']
        result = Process(
            words + [perform(word, context) for word in self.arguments],
            self.name,
            perform(self.namespace, context),
        )
        for item in self.parameters:
            if isinstance(item, ParameterFile):
                result.files.append(perform(item.param_file, context))
            else:
                result.parameters |= {
                    name: (
                        value.evaluate(context)
                        if isinstance(value, ParameterValue)
                        else perform(value, context)
                    )
                    for name, value in item.items()
                }
        return result


MODULES = {
    'launch': [LaunchDescription],
    'launch.actions': [
        DeclareLaunchArgument,
        ExecuteProcess,
        IncludeLaunchDescription,
        OpaqueFunction,
    ],
    'launch.launch_description_sources': [PythonLaunchDescriptionSource],
    'launch.substitutions': [
        LaunchConfiguration,
        PathJoinSubstitution,
    ],
    'launch_ros': [],
    'launch_ros.actions': [Node],
    'launch_ros.parameter_descriptions': [ParameterFile, ParameterValue],
    'launch_ros.substitutions': [ExecutableInPackage, FindPackageShare],
}


def load(monkeypatch: Any, path: Path) -> Any:
    """Run a launch file against the stand-ins."""
    for name, classes in MODULES.items():
        module = ModuleType(name)
        vars(module).update({item.__name__: item for item in classes})
        monkeypatch.setitem(sys.modules, name, module)
    return runpy.run_path(str(path))['generate_launch_description']()


def start(
    monkeypatch: Any, path: Path, *, processes: list[Process] | None = None, **arguments: str
) -> tuple[list[Process], dict[str, Any]]:
    """Perform a launch file; ``missing`` names packages that are not installed.

    Args:
        monkeypatch: Puts the stand-ins in place.
        path: The launch file.
        processes: Where to note what it starts, also when it fails.
        arguments: Its arguments.

    Returns:
        What it starts, and the arguments it declares by name, those of included files among them.
    """
    declared: dict[str, Any] = {}
    processes: list[Process] = [] if processes is None else processes
    _perform(monkeypatch, path, dict(arguments), declared, processes)
    unknown = set(arguments) - set(declared) - {'missing'}
    assert not unknown, f'no such arguments: {unknown}'
    return processes, declared


def _perform(monkeypatch, path, context, declared, processes):
    _visit(monkeypatch, load(monkeypatch, path).entities, context, declared, processes)


def _visit(monkeypatch, entities, context, declared, processes):
    for entity in entities:
        if isinstance(entity, DeclareLaunchArgument):
            declared.setdefault(entity.name, entity)
            if entity.default_value is not None:
                context.setdefault(entity.name, perform(entity.default_value, context))
        elif isinstance(entity, IncludeLaunchDescription):
            source = perform(entity.launch_description_source.launch_file_path, context)
            context |= {name: perform(value, context) for name, value in entity.launch_arguments}
            _perform(monkeypatch, Path(source), context, declared, processes)
        elif isinstance(entity, OpaqueFunction):
            found = entity.function(context) or []
            _visit(monkeypatch, found, context, declared, processes)
        else:
            processes.append(entity.start(context))
