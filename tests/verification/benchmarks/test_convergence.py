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

"""The benchmark of convergence."""

from types import SimpleNamespace

import numpy as np
import pytest

from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.lava import Lava
from lava_ros.verification.benchmarks import convergence


def test_scenes_are_cases() -> None:
    """Each has a vent on its ground and a time to run."""
    found = convergence.scenes()
    assert [case.name for case in found] == ['ridge', 'coarse_ridge', 'hill', 'valley', 'cliff']
    for case in found:
        assert case.duration > 0.0 and case.volume == case.duration * sum(
            vent.discharge for vent in case.scene.vents
        )


def test_a_scene_at_each_preset(device: str) -> None:
    """Finer presets have more particles; the finest is what it is compared with."""
    x = np.arange(40) * 5.0
    scene = Scene(
        Terrain(np.tile(-0.2 * x, (40, 1)), 5.0), (Vent((40.0, 100.0), 2.0),), Lava(viscosity=1e4)
    )
    case = convergence.case_of('incline', scene, 600.0)
    rows = [SimpleNamespace(**row) for row in convergence.compare(case, device=device, runs=2)]
    assert [row.preset for row in rows] == list(convergence.LADDER)
    assert rows[0].particles < rows[1].particles < rows[2].particles
    assert rows[0].spacing_m > rows[1].spacing_m > rows[2].spacing_m
    last = rows[-1]
    assert (last.jaccard, last.area_ratio, last.length_ratio) == (1.0, 1.0, 1.0)
    assert 0.5 < rows[1].jaccard <= 1.0 and rows[1].across == pytest.approx(16.0, rel=0.01)
