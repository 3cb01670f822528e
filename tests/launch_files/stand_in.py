# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Stand-ins for ``launch`` and ``launch_ros``, which only a full ROS installation has.

Their constructors have the arguments of the real ones. ``start`` performs a launch file and
returns the processes that it would start. test_real_launch.py runs the files with launch itself.
"""

from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
import runpy
import sys
from types import ModuleType
from typing import Any

import yaml

ROOT = Path(__file__).parents[2]

#: Required and, after /, optional arguments of constructors, by module and class.
MODULES = {
    'launch': {'LaunchDescription': 'entities'},
    'launch.actions': {
        'DeclareLaunchArgument': 'name / default_value description choices',
        'ExecuteProcess': 'cmd / output',
        'IncludeLaunchDescription': 'launch_description_source / launch_arguments',
        'OpaqueFunction': 'function', 'Shutdown': '/ reason',
    },
    'launch.launch_description_sources': {'PythonLaunchDescriptionSource': 'launch_file_path'},
    'launch.substitutions': {
        'LaunchConfiguration': 'variable_name', 'PathJoinSubstitution': 'substitutions',
    },
    'launch_ros': {},
    'launch_ros.actions': {
        'LifecycleNode': 'package executable name namespace / parameters arguments remappings '
        'output respawn respawn_delay on_exit',
        'Node': 'package executable / name namespace parameters arguments remappings output',
    },
    'launch_ros.parameter_descriptions': {
        'ParameterFile': 'param_file / allow_substs', 'ParameterValue': 'value / value_type',
    },
    'launch_ros.substitutions': {
        'ExecutableInPackage': 'executable package', 'FindPackageShare': 'package',
    },
    'launch_ros.utilities': {},
}


class Context(dict):
    """Values of arguments, as in a launch context; ``argv`` has the words of a command line."""

    def __init__(self, values: dict[str, str], argv: list[str]) -> None:
        super().__init__(values)
        self.argv = argv

    @property
    def launch_configurations(self):
        return self


def perform(value: Any, context: dict[str, str]) -> str:
    """Return the text of a substitution, of a list of them, or of a text."""
    if isinstance(value, (list, tuple)):
        return ''.join(perform(item, context) for item in value)
    kind = type(value).__name__
    if kind == 'str':
        return value
    if kind == 'LaunchConfiguration':
        return context[perform(value.variable_name, context)]
    if kind == 'PathJoinSubstitution':
        return str(Path(*(perform(item, context) for item in value.substitutions)))
    package = perform(value.package, context)
    if kind == 'FindPackageShare':
        assert package == 'lava_ros'
        return str(ROOT)
    assert kind == 'ExecutableInPackage', value
    if package in context.get('missing', ''):
        raise LookupError(f"package '{package}' not found")
    return f'{package}:{perform(value.executable, context)}'


def _modules() -> dict[str, ModuleType]:
    """Make modules of classes that keep the arguments of their constructors."""
    modules = {name: ModuleType(name) for name in MODULES}
    for module, classes in MODULES.items():
        for name, takes in classes.items():
            needed, _, rest = takes.partition('/')
            names = [*needed.split(), *((item, Any, field(default=())) for item in rest.split())]
            # actions take keyword arguments only, as in launch
            by_name = name in ('ExecuteProcess', 'LifecycleNode', 'Node', 'Shutdown')
            made = make_dataclass(name, names, namespace={'perform': perform}, kw_only=by_name)
            setattr(modules[module], name, made)
    names = modules['launch_ros.utilities']
    names.prefix_namespace = lambda base, name: '/'.join(filter(None, [base, name]))
    names.make_namespace_absolute = lambda name: f'/{name.lstrip("/")}'
    return modules


def evaluate(value: Any, context: dict[str, str]) -> Any:
    """Return the value of a parameter, of its type if it has one."""
    if type(value).__name__ != 'ParameterValue':
        is_plain = isinstance(value, (bool, int, float))
        return value if is_plain or isinstance(value, list) else perform(value, context)
    assert value.value_type is str or not isinstance(value.value, str), value.value
    text = perform(value.value, context)
    is_yaml = value.value_type in (bool, list[str])
    return yaml.safe_load(text) if is_yaml else (value.value_type or str)(text)


@dataclass
class Process:
    """A process that a launch file would start."""

    command: list[str]
    name: str | None = None
    namespace: str = ''
    parameters: dict[str, Any] = field(default_factory=dict)
    files: list[str] = field(default_factory=list)


def started(action: Any, context: dict[str, str]) -> Process:
    """Return the process of an action."""
    if type(action).__name__ == 'ExecuteProcess':
        return Process([perform(word, context) for word in action.cmd])
    program = f'{perform(action.package, context)}:{perform(action.executable, context)}'
    words = [perform(word, context) for word in action.arguments]
    result = Process([program, *words], action.name, perform(action.namespace, context))
    for item in action.parameters:
        if type(item).__name__ == 'ParameterFile':
            result.files.append(perform(item.param_file, context))
        else:
            result.parameters |= {name: evaluate(value, context) for name, value in item.items()}
    return result


def start(
    monkeypatch: Any, path: Path, *, processes: list[Process] | None = None, **arguments: str
) -> tuple[list[Process], dict[str, Any]]:
    """Perform a launch file; return its processes, and all declared arguments by name.

    ``missing`` names packages that are not installed, ``ros_namespace`` is the namespace of a
    PushRosNamespace around the file, and ``processes`` receives the processes even if it fails.
    """
    for name, module in _modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    declared: dict[str, Any] = {}
    processes = [] if processes is None else processes
    # a launch file may check the command line of ros2 launch
    own = ('missing', 'ros_namespace')
    words = [f'{name}:={value}' for name, value in arguments.items() if name not in own]
    monkeypatch.setattr(sys, 'argv', ['ros2', 'launch', str(path), *words])
    _visit(_entities(path), Context(arguments, words), declared, processes)
    return processes, declared


def _entities(path):
    return runpy.run_path(str(path))['generate_launch_description']().entities


def _visit(entities, context, declared, processes):
    for entity in entities:
        kind = type(entity).__name__
        if kind == 'DeclareLaunchArgument':
            declared.setdefault(entity.name, entity)
            if entity.default_value != ():
                context.setdefault(entity.name, perform(entity.default_value, context))
        elif kind == 'IncludeLaunchDescription':
            source = perform(entity.launch_description_source.launch_file_path, context)
            context |= {name: perform(value, context) for name, value in entity.launch_arguments}
            _visit(_entities(source), context, declared, processes)
        elif kind == 'OpaqueFunction':
            _visit(entity.function(context) or [], context, declared, processes)
        else:
            processes.append(started(entity, context))
