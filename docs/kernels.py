# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write docs/kernels.md, the arrays that kernels read and write: `python docs/kernels.py`.

They are derived from the syntax trees of the kernels and of the functions that these call.
"""

import ast
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from graphlib import TopologicalSorter
from inspect import getclosurevars, signature
from itertools import chain, pairwise, product
from pathlib import Path
import re
import sys
from typing import Any

import warp as wp

from lava_ros.effects import compatible, EFFECTS
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy, FORMULATIONS
from lava_ros.simulation.backend.graph import Launches
from lava_ros.simulation.output.peaks import Peaks
from lava_ros.simulation.step.effects import parts_of
from lava_ros.verification.benchmarks.effects import lava_field

PAGE = Path(__file__).with_name('kernels.md')

#: C++ that reads items of an array; everything else that uses its data may change them.
READ = (
    r'(?:const [^<>]*>\(|__ldg\(|__atomic_load\(|memcpy\(&\w+, |"ld\.[^;]*;"[^;]*"l"\()'
    r'\s*{0}\.data\b|'
    r'\b{0}\.data\[(?:[^][]|\[[^]]*\])*\](?!\s*[-+*/|&^]?=[^=])'
)

#: Settings that compile different kernels.
PLAIN = Accuracy(spacing=1.0, thickness=1.0, integrator='euler', precision='float64')
STAGED = Accuracy(
    spacing=1.0, thickness=1.0, gradient='balanced', deterministic=True, longest_step=1e6
)
PRINTED = Accuracy(spacing=1.0, thickness=1.0, integrator='euler', formulation='as-published')


class Accesses(ast.NodeVisitor):
    """Arrays that a device function reads and writes, and those of the functions that it calls.

    An array that is only added to, or raised, counts as written.

    Attributes:
        function: The device function.
        reads, writes: Names of the arrays: members of ``m`` (``layout.arguments_type``), such as
            ``flow`` or ``cells.sizes``, or of another argument, such as ``outlets.due``.
    """

    def __init__(self, function: Any, arguments: Mapping[str, Any]) -> None:
        """Follow a function whose ``arguments`` are arrays or structs: name and type of each."""
        self.function = function
        self.reads, self.writes = set[str](), set[str]()
        self._known = dict(arguments)
        used = getclosurevars(function.func)
        self._scope = {**used.globals, **used.nonlocals}
        if function.native_snippet:
            self._search(function.native_snippet)
        else:
            for statement in function.adj.tree.body[0].body:
                self.visit(statement)

    def _search(self, code: str) -> None:
        """Find the accesses of a C++ function."""
        arrays = {}
        for argument, (name, kind) in self._known.items():
            if isinstance(kind, wp.array):
                arrays[argument] = name
            else:
                members = (key for key, one in kind.vars.items() if isinstance(one.type, wp.array))
                arrays |= {f'{argument}.{member}': f'{name}.{member}' for member in members}
        for item, name in arrays.items():
            used = re.findall(rf'\b{re.escape(item)}\b(\.data|\.shape|\.strides|)', code)
            assert '' not in used, f'{self.function.key}: cannot follow {item}'
            if '.data' in used:
                read = len(re.findall(READ.format(re.escape(item)), code))
                (self.reads if read == used.count('.data') else self.writes).add(name)

    def _array_or_struct(self, node: ast.AST) -> Any:
        """Return name and type of an array or a struct, None for anything else."""
        if isinstance(node, ast.Name):
            return self._known.get(node.id)
        owner = self._array_or_struct(node.value) if isinstance(node, ast.Attribute) else None
        part = getattr(owner[1], 'vars', {}).get(node.attr) if owner else None
        if part and (isinstance(part.type, wp.array) or hasattr(part.type, 'vars')):
            return f'{owner[0]}.{node.attr}'.lstrip('.'), part.type
        return None

    def visit_Name(self, node: ast.Name) -> None:
        """Refuse uses of arrays and structs that are not followed below."""
        assert node.id not in self._known, f'{self.function.key}: cannot follow {node.id}'

    def visit_Subscript(self, node: ast.Subscript | ast.Attribute) -> None:
        """Note an access to an item."""
        inner: Any = node
        outer = None
        while isinstance(inner, ast.Subscript | ast.Attribute):
            if self._array_or_struct(inner):
                break
            if isinstance(inner, ast.Subscript):
                self.visit(inner.slice)
            inner, outer = inner.value, inner
        found = self._array_or_struct(inner)
        if not found:
            self.visit(inner)
        elif isinstance(outer, ast.Subscript):
            (self.writes if isinstance(node.ctx, ast.Store) else self.reads).add(found[0])
        else:
            # a member that is a number, or the shape of an array
            assert outer, f'{self.function.key}: cannot follow {ast.unparse(node)}'

    def visit_Attribute(self, node: ast.Attribute) -> None:
        """Note an access to a component of an item."""
        self.visit_Subscript(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        """Follow a value, which may be another name of an array."""
        found = self._array_or_struct(node.value)
        if not found:
            self.visit(node.value)
        for target in node.targets:
            self.visit(target)
            if found and isinstance(target, ast.Name):
                self._known[target.id] = found

    def visit_If(self, node: ast.If) -> None:
        """Follow the branches that are compiled."""
        if isinstance(node.test, ast.Constant):
            statements = node.body if node.test.value else node.orelse
        else:
            statements = [*node.body, *node.orelse]
            # an array is true if there is one
            if not self._array_or_struct(node.test):
                self.visit(node.test)
        for statement in statements:
            self.visit(statement)

    def visit_Call(self, node: ast.Call) -> None:
        """Follow a function that takes an array or a struct; it has no other access to them."""
        values = [self._array_or_struct(value) for value in node.args]
        for value, found in zip(node.args, values, strict=True):
            if not found:
                self.visit(value)
        for keyword in node.keywords:
            self.visit(keyword.value)
        if not any(values):
            return
        function = eval(ast.unparse(node.func), self._scope)
        if function.is_builtin():
            changes = function.key.startswith('atomic_')
            (self.writes if changes else self.reads).update(one[0] for one in values if one)
            return
        names = signature(function.func).parameters
        inner = Accesses(function, {n: v for n, v in zip(names, values, strict=True) if v})
        self.reads |= inner.reads
        self.writes |= inner.writes


@cache
def accesses_of(kernel: Any) -> Accesses:
    """Return the accesses of a ``compiled.quick_kernel``."""
    types = kernel.body.func.__annotations__.items()
    arguments = {
        name: ('' if name == 'm' else name, kind) for name, kind in types
        if isinstance(kind, wp.array) or hasattr(kind, 'vars')
    }
    return Accesses(kernel.body, arguments)


@cache
def listed_writes() -> dict[tuple[str, str], set[str]]:
    """Return the arrays that each kernel writes by the page, by its place."""
    rows = re.findall(r'\| `(.*)` \| `(.*)` \| .* \| (.*) \|', PAGE.read_text(encoding='utf-8'))
    return {(file, name): set(re.findall(r'[\w.]+', writes)) for name, file, writes in rows}


def check(kernel: Any) -> None:
    """Check that a kernel of the package writes only arrays that the page lists.

    Raises:
        AssertionError: If it writes another array.
    """
    if kernel.body.func.__module__.startswith('lava_ros.'):
        more = accesses_of(kernel).writes - listed_writes().get(place_of(kernel), set())
        assert not more, f'{kernel.body.key} writes {sorted(more)} beyond {PAGE.name}'


class _Recorder(Launches):
    """Launches that are recorded, with the kernels of a single simulation."""

    is_capturing = False


class _Gpu(str):
    """A GPU where kernels are chosen, and the device of that name for Warp."""

    is_cuda = True


def recorded() -> Iterator[tuple[list[Any], list[Any]]]:
    """Yield the kernels of a stage, and those of output, for many effects and settings.

    They are those of a CPU, then those of a GPU. None of them runs.
    """
    printed = compatible(name for name, on in FORMULATIONS[PRINTED.formulation].items() if on)
    names = [name for name in EFFECTS if [*parts_of(compatible([name]))]]
    without_parts = compatible(name for name in EFFECTS if name not in names)
    cases = [(printed, PRINTED), *product([compatible(()), without_parts], [PLAIN, STAGED])]
    for name in names:
        cases += (compatible([name]), PLAIN), (compatible([name, *EFFECTS]), STAGED)
    scene = lava_field(64, compatible(()), 'cpu').scene
    for effects, accuracy in cases:
        solver: Any = Simulation(scene, effects=effects, accuracy=accuracy, device='cpu').solver
        state, peaks = solver.state, Peaks(scene.terrain.shape, 0.1, 0.0, 'cpu')
        raise_peaks = partial(peaks.observe, state, solver.terrain.known, solver.raster)
        state.launches = _Recorder(state.device)
        for is_gpu in (False, True):
            if is_gpu:
                state.device = _Gpu('cpu')
                state.form = state.form._replace(is_ranked_again=accuracy.deterministic)
                solver.build_stage()
            stage = [solver.bin, solver.take_stages]
            output = [
                solver.draw_maps, raise_peaks, solver.record_covered_ground,
                solver.stage.finish_flow,
            ]
            first, second = (
                [one.kernel for launch in part for one in state.launches.record(launch, 64)]
                for part in (stage, output)
            )
            yield first, second


def place_of(function: Any) -> tuple[str, str]:
    """Return file and name of a device function or a kernel."""
    function = getattr(function, 'body', function).func
    module = function.__module__.removeprefix('lava_ros.simulation.')
    return f'{module.replace(".", "/")}.py', function.__name__


def in_order(sequences: Iterable[Iterable[Any]]) -> list[tuple[str, str]]:
    """Return the places of the kernels of several sequences, each after those before it."""
    order = TopologicalSorter[tuple[str, str]]()
    for sequence in sequences:
        places = [*dict.fromkeys(map(place_of, sequence))]
        for before, after in pairwise(places):
            order.add(after, before)
    return [*order.static_order()]


@cache
def forms() -> tuple[dict[tuple[str, str], list[Accesses]], ...]:
    """Return the accesses of all forms of each kernel of a stage, and of others, by place."""
    stages, output = zip(*recorded(), strict=True)
    modules = [module for name, module in sys.modules.items() if name.startswith('lava_ros.')]
    at_import = [
        one for module in modules for one in vars(module).values()
        if isinstance(one, wp.Kernel) and hasattr(one, 'body')
    ]
    found: dict[tuple[str, str], list[Accesses]] = {}
    for kernel in dict.fromkeys(chain(*stages, *output, at_import)):
        found.setdefault(place_of(kernel), []).append(accesses_of(kernel))
    of_stage = in_order(stages)
    others = dict.fromkeys((*in_order(output), *found))
    return tuple(
        {place: found[place] for place in places}
        for places in (of_stage, [place for place in others if place not in of_stage])
    )


def table(kernels: Mapping[tuple[str, str], Sequence[Accesses]]) -> Iterator[str]:
    """Yield the lines of a table of kernels."""
    yield '| kernel | file | reads | writes |\n|---|---|---|---|\n'
    for (file, name), found in kernels.items():
        cells = []
        for sets in ([one.reads for one in found], [one.writes for one in found]):
            names, always = sorted(set().union(*sets)), sets[0].intersection(*sets)
            cells.append(', '.join(one if one in always else f'({one})' for one in names))
        yield f'| `{name}` | `{file}` | {" | ".join(cells)} |\n'


def page() -> str:
    """Return the page."""
    stages, others = forms()
    return f"""# Arrays of the kernels

`python docs/kernels.py` writes this page from the syntax trees of the kernels of particles (those
of `quick_kernel`) and of the functions that they call. `Arrays` in
`simulation/particles/layout.py` states what most arrays contain; other names are those of a
kernel's own arguments. Names in parentheses: only with some effects, settings or devices. An array
that is only added to, or raised, counts as written.

## In the order of a stage

{''.join(table(stages))}
## Output, and the start of a simulation

{''.join(table(others))}"""


if __name__ == '__main__':
    PAGE.write_text(page(), encoding='utf-8')
