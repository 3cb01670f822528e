# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""PTX of a stage's kernels, checked without a GPU, in ``make nightly``.

Spilled arrays and exact division change no result but may double the time.
"""

from collections import Counter
from functools import cached_property, lru_cache, partial
import re
import struct
from types import SimpleNamespace

import pytest
import warp as wp

from lava_ros.simulation.backend.compiled import FEW_THREADS
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.step import fused_stage
from lava_ros.simulation.step.timestep import StageChoice
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field

#: Sets of effects, by their names in the benchmark.
SETS = ('bare', 'green', 'everything with green')

#: Kernels that sum over neighbours in every step.
SUMS = ('thickness_and_velocity', 'elevate', 'balanced_velocity', 'green_motion')


#: Attribute in a cubin's .nv.info: a kernel's minimum stack.
_STACK = 0x12


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
    def stack(self):
        """Stack of a thread including spilled registers [B]."""
        return stack_of(self._compile(use_ptx=False)[0].read_bytes())


def opcodes(text):
    found = re.findall(r'^\s*(?:@\S+\s+)?([a-z][a-z0-9_]*\.[a-z0-9_.:]+)\s', text, re.MULTILINE)
    return Counter(opcode.replace('.ftz', '') for opcode in found)


def stack_of(cubin):
    """Return the stack of a cubin's only kernel, from the ELF's .nv.info."""
    (table,) = struct.unpack_from('<Q', cubin, 0x28)
    count, names = struct.unpack_from('<HH', cubin, 0x3C)
    sections = [struct.unpack_from('<IIQQQQ', cubin, table + 64 * n) for n in range(count)]
    begin = sections[names][4]
    offset, end = next(
        (at, at + size)
        for name, _, _, _, at, size in sections
        if cubin[begin + name :].startswith(b'.nv.info\0')
    )
    found = []
    while offset < end:
        form, attribute, size = struct.unpack_from('<BBH', cubin, offset)
        offset += 4
        if form == 4:
            if attribute == _STACK:
                found.append(struct.unpack_from('<II', cubin, offset)[1])
            offset += size
    (stack,) = found
    return stack


def launched(name, is_short=False, is_fused=False):
    """Return the kernels that a stage would launch on a GPU.

    ``is_fused``: the first block of the motion chooses the stage and emits, where it may.
    """
    kernels = []

    def is_within_the_motion(state, **_):
        return is_fused and not state.form.has_velocity

    def record(kernel, *_, record_cmd=False, **__):
        def launch():
            if kernel not in kernels:
                kernels.append(kernel)

        if record_cmd:
            return SimpleNamespace(launch=launch)
        return launch()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wp, 'launch', record)
        patch.setattr(State, 'is_short', is_short)
        patch.setattr(fused_stage, 'is_within_the_motion', is_within_the_motion)
        if is_short and not is_fused:
            # a fused kernel has the same registers for the threads of particles
            patch.setattr(fused_stage, 'StageChoice', partial(StageChoice, bounds=FEW_THREADS))
        patch.setattr(State, 'is_wide', False)
        simulation = lava_field(400, effect_sets()[name], 'cpu')
        vents = simulation.solver.vents
        assert vents.outlets, 'made before the first stage'
        kernels.clear()
        simulation.solver.stage.take(simulation.scene, vents)
    return kernels


@pytest.fixture(scope='module')
def compiled(tmp_path_factory):
    """Compile kernels for an architecture."""
    folder = tmp_path_factory.mktemp('compiled')
    return lambda kernels, arch=90: [Code(kernel, arch, folder) for kernel in kernels]


@pytest.fixture(scope='module')
def stage(compiled):
    return lru_cache(lambda name: compiled(launched(name)))


def check_local(code):
    """Check that nothing is kept, or spilled, outside the registers."""
    assert '.local' not in code.text, code.name
    assert code.stack == 0, f'{code.name}: {code.stack} bytes'


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


@pytest.mark.nightly
@pytest.mark.parametrize('name', SETS)
@pytest.mark.parametrize('check', [check_local, check_arithmetic, check_wait])
def test_kernels_do_not_spill_divide_slowly_or_read_early(stage, name, check):
    for code in stage(name):
        check(code)


def of_all_sets(**options):
    """Return the kernels of all sets of effects by their modules."""
    return {
        kernel.module.name: kernel
        for name in effect_sets()
        for kernel in launched(name, **options)
    }.values()


@pytest.mark.nightly
@pytest.mark.parametrize('is_short', [False, True])
def test_effects_compile_without_local_memory(compiled, is_short):
    codes = compiled(of_all_sets(is_short=is_short), arch=80)
    others = {'accelerate', 'exchange_heat', 'freeze', 'merge', 'emit', 'sweep', 'move'}
    assert {code.name for code in codes} >= others
    for code in codes:
        assert code.stack == 0, code.name


@pytest.mark.nightly
def test_first_block_of_the_motion_keeps_no_array(compiled):
    """It may spill single registers (fused_stage.py), which only the compiler's output has."""
    codes = compiled(of_all_sets(is_short=True, is_fused=True), arch=80)
    assert any('membar' in code.text for code in codes if code.name == 'move')
    for code in codes:
        assert '.local' not in code.text, code.name


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
    assert code.stack > 0
    with pytest.raises(AssertionError):
        check_local(code)
