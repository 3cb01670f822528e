# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""PTX of a stage's kernels, checked without a GPU; most tests run in ``make nightly``.

Narrow memory accesses, spilled arrays and exact division change no result but may double the time.
"""

from collections import Counter
from dataclasses import replace
from functools import cached_property, lru_cache, partial
import re
import struct
from types import SimpleNamespace

import pytest
import warp as wp

from lava_ros.simulation import Simulation
from lava_ros.simulation.backend.batched_launches import BLOCK
from lava_ros.simulation.backend.compiled import FEW_THREADS
from lava_ros.simulation.particles import neighbors
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.step import stage as stages
from lava_ros.simulation.step.fused_stage import BOUNDS
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field

#: Sets of effects, by their names in the benchmark: one in every run, all of them nightly.
GREEN_SETS = tuple(
    pytest.param(name, marks=pytest.mark.nightly) for name in ('green', 'everything with green')
)
SETS = ('bare', *GREEN_SETS)

#: Kernels that sum over neighbours in every step, and kernels that only move particle data.
SUMS = ('thickness_and_velocity', 'elevate', 'velocity_of_differences', 'green_motion')
CARRIERS = ('order_particles', 'move', 'green_motion')

#: Number of carriers in a stage.
CARRIED_BY = 2

#: Maximum number of loads per neighbour.
MAX_LOADS = 3

#: Stack of a thread in the first block of the motion of many particles [B].
DIRECTORS_STACK, MEMBERS_STACK = 80, 256

#: Minimum number of registers of a kernel that loads four neighbours at once.
FOUR_AT_ONCE = 40

#: Attributes in a cubin's .nv.info: a kernel's minimum stack, and its registers.
_STACK, _REGISTERS = 0x12, 0x2F


class Code:
    """A kernel as compiled for an architecture, with the properties that tests check."""

    def __init__(self, kernel, arch, folder):
        self.name = kernel.key.rpartition('__')[2]
        options = {'arch': arch, 'module_dir': folder}
        self._compile = partial(wp.compile_aot_module, kernel.module, **options)

    @cached_property
    def text(self):
        ptx = self._compile(use_ptx=True)[0].read_text(encoding='latin-1')
        return ptx[ptx.index('.entry') :]

    @cached_property
    def needs(self):
        """Stack of a thread including spilled registers [B], and number of registers."""
        return needs_of(self._compile(use_ptx=False)[0].read_bytes())

    @property
    def loops(self) -> list[str]:
        """PTX of the loops without branches."""
        blocks = re.findall(r'(\$L__BB\w+):(.*?)(?=\n\$L__BB\w+:|\Z)', self.text, re.DOTALL)
        return [text for label, text in blocks if re.search(rf'\sbra\S*\s+\{label};', text)]


def opcodes(text):
    found = re.findall(r'^\s*(?:@\S+\s+)?([a-z][a-z0-9_]*\.[a-z0-9_.:]+)\s', text, re.MULTILINE)
    return Counter(opcode.replace('.ftz', '') for opcode in found)


def needs_of(cubin):
    """Return stack and registers of a cubin's only kernel, from the ELF's .nv.info."""
    (table,) = struct.unpack_from('<Q', cubin, 0x28)
    count, names = struct.unpack_from('<HH', cubin, 0x3C)
    sections = [struct.unpack_from('<IIQQQQ', cubin, table + 64 * n) for n in range(count)]
    begin = sections[names][4]
    (offset, end), found = next(
        (at, at + size)
        for name, _, _, _, at, size in sections
        if cubin[begin + name :].startswith(b'.nv.info\0')
    ), {_STACK: [], _REGISTERS: []}
    while offset < end:
        form, attribute, size = struct.unpack_from('<BBH', cubin, offset)
        offset += 4
        if form == 4:
            if attribute in found:
                found[attribute].append(struct.unpack_from('<II', cubin, offset)[1])
            offset += size
    (stack,), (registers,) = found.values()
    return stack, registers


def launched(name, lanes=1, integrator='euler', is_short=None, directs=None, parts=None):
    """Return the kernels that a stage would launch; with several lanes those for few particles.

    Sums have as many parts as there are lanes, except for members of a batch: one lane, four
    parts.
    """
    is_short = lanes > 1 if is_short is None else is_short
    directs = is_short if directs is None else directs
    kernels = []

    def record(kernel, *_, record_cmd=False, **__):
        def launch():
            if kernel not in kernels:
                kernels.append(kernel)

        if record_cmd:
            return SimpleNamespace(launch=launch)
        return launch()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wp, 'launch', record)
        patch.setattr(State, 'lanes', property(lambda _: lanes))
        patch.setattr(State, 'parts', property(lambda _: parts or lanes))
        patch.setattr(State, 'is_short', is_short)
        patch.setattr(stages, 'is_within_the_motion', lambda *_, **__: directs)
        patch.setattr(State, 'is_wide', False)
        simulation = lava_field(400, effect_sets()[name], 'cpu')
        if integrator != 'euler':
            accuracy = replace(simulation.accuracy, integrator=integrator, fixed_step=None)
            simulation = Simulation(
                simulation.scene, effects=simulation.effects, accuracy=accuracy, device='cpu'
            )
        kernels.clear()
        simulation.solver.stage.take(simulation.scene, simulation.solver.vents)
    return kernels


@pytest.fixture(scope='module')
def compiled(tmp_path_factory):
    """Compile kernels, all or the named ones, for an architecture."""
    folder = tmp_path_factory.mktemp('compiled')

    def of(kernels, names=None, arch=90):
        codes = [Code(kernel, arch, folder) for kernel in kernels]
        return [code for code in codes if names is None or code.name in names]

    return of


@pytest.fixture(scope='module')
def stage(compiled):
    return lru_cache(lambda name: compiled(launched(name)))


def check_sum(code):
    """Check that a neighbour (a root or a logarithm) takes few, read-only, mostly wide loads."""
    loops = []
    for loop in code.loops:
        counts = opcodes(loop)
        neighbours = counts['sqrt.approx.f32'] + counts['lg2.approx.f32']
        # other loads belong to the first block (fused_stage.py), or wait for it
        if neighbours and not any(name.startswith('ld.relaxed') for name in counts):
            loops.append((neighbours, counts))
    assert loops, f'{code.name} has no loop over neighbours without a branch'
    for neighbours, counts in loops:
        loads = {name: n for name, n in counts.items() if name.startswith('ld.')}
        wide = sum(n for name, n in loads.items() if re.search(r'\.v[24]\.f32$', name))
        assert all(name.startswith('ld.global.nc.') for name in loads), f'{code.name}: {loads}'
        assert wide >= neighbours, f'{code.name}: {loads}'
        assert sum(loads.values()) <= MAX_LOADS * neighbours, f'{code.name}: {loads}'


def check_carrier(code, wide):
    """Check that particles are accessed 16 bytes at a time, position remainders 8 bytes."""
    counts = opcodes(code.text)
    for access in ('ld.global.nc', 'st.global'):
        assert counts[f'{access}.v4.f32'] >= wide, code.name
        assert counts[f'{access}.v2.f32'] >= 1, code.name


def check_local(code):
    """Check that nothing is kept, or spilled, outside the registers."""
    assert '.local' not in code.text, code.name
    assert code.needs[0] == 0, f'{code.name}: {code.needs[0]} bytes'


def check_arithmetic(code):
    """Check that float32 never uses the subroutines with exact rounding."""
    counts = opcodes(code.text)
    slow = [name for name in counts if re.fullmatch(r'(div|sqrt|rcp)\.r.\.f32', name)]
    assert not slow, f'{code.name}: {slow}'
    assert counts['sqrt.approx.f32'] or code.name not in SUMS


def check_wait(code):
    """Check that no memory is accessed before the preceding kernels have ended."""
    before, wait, after = code.text.partition('griddepcontrol.wait;')
    assert wait, f'{code.name} does not wait'
    access = re.compile(r'^\s*(@\S+\s+)?(ld|st|atom|red)\.(global|volatile|relaxed)', re.M)
    assert not access.search(before), code.name
    assert access.search(after), code.name


@pytest.mark.parametrize('name', SETS)
def test_sums_read_neighbours_with_few_wide_loads(stage, name):
    sums = [code for code in stage(name) if code.name in SUMS]
    assert len(sums) == 1 + ('green' in name)
    for code in sums:
        check_sum(code)


@pytest.mark.parametrize('name', SETS)
def test_particles_move_16_bytes_at_a_time(stage, name):
    carriers = [code for code in stage(name) if code.name in CARRIERS]
    assert len(carriers) == CARRIED_BY
    for code in carriers:
        check_carrier(code, 1)


@pytest.mark.nightly
def test_multistage_steps_move_16_bytes_at_a_time(compiled):
    codes = compiled(launched('bare', integrator='rkl2'), CARRIERS)
    assert len(codes) == CARRIED_BY
    for code in codes:
        check_carrier(code, 3)
        check_local(code)
        check_arithmetic(code)


@pytest.mark.nightly
@pytest.mark.parametrize('name', SETS)
@pytest.mark.parametrize('check', [check_local, check_arithmetic, check_wait])
def test_kernels_do_not_spill_divide_slowly_or_read_early(stage, name, check):
    for code in stage(name):
        check(code)


@pytest.mark.parametrize('name', GREEN_SETS)
def test_k0_takes_one_logarithm_and_one_power(stage, name):
    (code,) = [code for code in stage(name) if code.name == 'green_motion']
    (loop,) = code.loops
    counts = opcodes(loop)
    # the loop is unrolled, and each neighbour is limited to its own disc once
    neighbours = counts['max.f32']
    assert neighbours >= 1
    for opcode in ('lg2.approx.f32', 'ex2.approx.f32'):
        assert counts[opcode] == neighbours, opcode
    others = ('div', 'rcp', 'rsqrt', 'sqrt')
    assert not [opcode for opcode in counts if opcode.startswith(others)]


@pytest.mark.nightly
@pytest.mark.parametrize(('arch', 'lanes'), [(80, 1), (80, 4), (90, 4)])
def test_sums_are_efficient_on_sm80_and_with_shared_particles(compiled, arch, lanes):
    codes = compiled(launched('green', lanes=lanes), SUMS, arch)
    assert len(codes) == 2
    for code in codes:
        check_sum(code)
        check_local(code)
        check_arithmetic(code)
        assert bool(opcodes(code.text)['shfl.sync.bfly.b32']) == (lanes > 1)


@pytest.mark.nightly
def test_deterministic_order_is_efficient(compiled):
    kernels = neighbors._kernels(wp.float32, True, False, True, True, False, True)
    order, members = compiled(kernels, ('order_particles', 'list_members'))
    check_local(order)
    check_local(members)
    check_carrier(order, 3)


@pytest.mark.nightly
@pytest.mark.parametrize('lanes', [1, 4])
@pytest.mark.parametrize('name', SETS)
def test_few_particles_use_many_registers(compiled, name, lanes):
    codes = compiled(launched(name, lanes=lanes, is_short=True), (*SUMS, 'move'))
    assert len(codes) == 2
    for code in codes:
        assert FOUR_AT_ONCE <= code.needs[1] <= 65536 // FEW_THREADS[0] // FEW_THREADS[1]
        check_local(code)


@pytest.mark.nightly
@pytest.mark.parametrize('name', SETS)
def test_members_of_a_batch_fill_a_processor(compiled, name):
    for kernel in launched(name, parts=4, directs='green' in name):
        what = kernel.key.rpartition('__')[2]
        if what in (*SUMS, 'move'):
            directs = what == 'green_motion'
            threads = FEW_THREADS[0] if directs else BLOCK
            (code,) = compiled([kernel.for_many(threads, not directs)[1]])
            stack, registers = code.needs
            blocks = FEW_THREADS[1] if directs else 4 - (name not in ('bare', 'green'))
            assert registers <= 65536 // threads // blocks, what
            assert stack <= (MEMBERS_STACK if directs else 0), what


@pytest.mark.nightly
@pytest.mark.parametrize('name', ['green', 'everything with green'])
def test_control_block_takes_no_registers_of_others(compiled, name):
    motions = [
        next(kernel for kernel in kernels if kernel.key.endswith('green_motion'))
        for kernels in (launched(name), launched(name, directs=True))
    ]
    assert motions[1].options['launch_bounds'] == BOUNDS[False]
    alone, directed = compiled(motions)
    assert alone.needs[1] >= directed.needs[1] == 65536 // BOUNDS[False][0] // 8 // 6 * 8
    assert alone.needs[0] == 0 < directed.needs[0] <= DIRECTORS_STACK
    check_sum(directed)
    check_carrier(directed, 1)
    check_arithmetic(directed)


@pytest.mark.nightly
@pytest.mark.parametrize('is_short', [False, True])
def test_effects_compile_without_local_memory(compiled, is_short):
    kernels = {
        kernel.module.name: kernel
        for name in effect_sets()
        for kernel in launched(name, is_short=is_short)
    }
    codes = compiled(kernels.values(), arch=80)
    others = {'accelerate', 'exchange_heat', 'freeze', 'merge', 'emit', 'sweep'}
    assert {code.name for code in codes} >= others.union(CARRIERS)
    for code in codes:
        assert code.needs[0] == 0, code.name


vec64 = wp.types.vector(64, float)


@wp.kernel(module='unique', enable_backward=False)
def indexed_at_run_time(values: wp.array(dtype=float)):
    """Keep an array that cannot be in registers."""
    kept = vec64()
    for n in range(values.shape[0]):
        kept[n % 64] = kept[(n * n) % 64] + values[n]
    values[0] = kept[values.shape[0] % 64]


def test_checks_detect_local_memory(compiled):
    (code,) = compiled([indexed_at_run_time])
    assert code.needs[0] > 0
    with pytest.raises(AssertionError):
        check_local(code)
