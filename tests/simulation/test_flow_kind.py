# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The kind of a flow, for flows whose authors state it, and lava that cannot be."""

from dataclasses import replace
import math
from types import SimpleNamespace

import numpy as np
import pytest

from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.emplaced import EmplacedFlow
from lava_ros.scene.materials import material_named
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.flow_kind import crust_time, kind_of, MAX_STRESS
from lava_ros.simulation.output.measurement import current_resolution
from lava_ros.simulation.resolution import Resolution, resolution_of
from project import ROOT
from scripts import load_script

#: Minimum fraction of the described flows whose kind must be found: 17 of 20.
MIN_RIGHT = 17 / 20


FLOWS = load_script(ROOT / 'docs/benchmarks/described_flows.py').described_flows()

SCENE = Scene(
    Terrain(np.zeros((4, 4), dtype=np.float32), 10.0), (),
    material_named('basalt').lava,
)


@pytest.mark.parametrize('flow', [
    pytest.param(item, id=item.name, marks=[pytest.mark.xfail(
        reason=item.missed_because, strict=True,
    )] if item.missed_because else [])
    for item in FLOWS
])
def test_kind_is_that_which_the_authors_state(flow):
    assert flow.found.name == flow.kind, flow.found.text()


def test_kind_is_right_for_most_described_flows():
    right = sum(item.found.name == item.kind for item in FLOWS)
    assert len(FLOWS) >= 20 and right >= MIN_RIGHT * len(FLOWS)


def test_kinds_outside_the_model_cause_warnings():
    for item in FLOWS:
        found = item.found
        lacking = found.name in ('tube-fed', 'dome', 'turbulent')
        assert bool(found.warnings()) == lacking
        assert found.reason in found.text()


@pytest.mark.parametrize('material', ['etna_basalt', 'basalt'])
def test_expected_flow_of_low_rate_on_a_gentle_slope_is_tube_fed(material):
    chosen = material_named(material)
    fall = -math.tan(math.radians(1.5)) * 30.0 * np.arange(80, dtype=np.float32)
    ground = Terrain(np.tile(fall, (40, 1)), 30.0)
    vent = Vent((450.0, 600.0), 1.0, temperature=chosen.vent_temperature.value)
    gentle = Scene(ground, (vent,), chosen.lava)
    found = resolution_of(gentle, Accuracy(), horizon=30 * 86400.0)
    assert found.kind.name == 'tube-fed'
    assert any('outside the model' in text for text in found.warnings())
    steep = replace(gentle, terrain=Terrain(20.0 * ground.elevation, 30.0))
    assert resolution_of(steep, Accuracy(), horizon=30 * 86400.0).kind.name == 'channel'


def test_stress_that_no_lava_holds_is_implausible():
    flow = next(item for item in FLOWS if item.kind == 'channel').found
    shape = {'thickness': 60.0, 'width': 300.0, 'diameter': 400.0}
    for stress, count in ((0.9 * MAX_STRESS, 0), (1.1 * MAX_STRESS, 1)):
        texts = replace(flow, **shape, stress=stress, is_measured=True).warnings()
        assert sum('implausible' in text for text in texts) == count


def test_crust_takes_forever_without_loss_of_heat():
    lava = replace(SCENE.lava, emissivity=0.0, convection=0.0)
    assert crust_time(replace(SCENE, lava=lava), 1420.0) == math.inf
    assert 10.0 < crust_time(SCENE, 1420.0) < 100.0


@pytest.mark.parametrize(
    ('height', 'slope', 'is_pond', 'is_flagged'),
    [(131.0, 0.026, False, True), (8.0, 0.17, False, False), (131.0, 0.0, True, False)],
)
def test_measured_mound_of_basalt_is_implausible_and_a_pond_is_not(
    height, slope, is_pond, is_flagged
):
    cell, shape = 10.0, (80, 80)
    y, x = cell * (np.indices(shape) - 40)
    bowl = np.maximum(1.0 - np.hypot(x, y) / 200.0, 0.0)
    ground = (-slope * x - is_pond * height * bowl).astype(np.float32)
    lava = (height * (bowl if is_pond else np.sqrt(bowl))).astype(np.float32)
    snapshot = SimpleNamespace(
        terrain=Terrain(ground, cell), thickness=lava, standing=lava > 0.1, inundated=None,
    )
    expected = next(item for item in FLOWS if item.name == 'Etna 2001, lower fissure').found
    resolution = Resolution(cell, 1.0, math.nan, math.nan, cell, 'given', kind=expected)
    accuracy = Accuracy(spacing=cell, thickness=1.0)
    found = current_resolution(snapshot, accuracy, resolution).kind
    assert found.is_measured and found.thickness > 0.4 * height
    assert any('implausible' in text for text in found.warnings()) == is_flagged


def test_emplaced_lava_that_cannot_be_is_flagged_without_a_vent():
    """Whatever the cause of a mound: here it is there at the start."""
    fall = -0.1 * 10.0 * np.arange(60, dtype=np.float32)
    ground = Terrain(np.tile(fall, (60, 1)), 10.0)
    for height, is_flagged in ((150.0, True), (3.0, False)):
        thickness = np.zeros((60, 60))
        thickness[20:40, 20:40] = height
        flow = EmplacedFlow(thickness, 10.0, (0.0, 0.0))
        scene = Scene(ground, (), material_named('etna_basalt').lava, emplaced_flows=(flow,))
        simulation = Simulation(scene, accuracy=Accuracy(spacing=10.0), device='cpu')
        found = current_resolution(
            simulation.snapshot(), simulation.accuracy, simulation.resolution
        )
        assert found.kind.name == 'unfed' and found.kind.is_measured
        assert any('implausible' in text for text in found.warnings()) == is_flagged
    assert kind_of(Scene(ground, (), scene.lava), 3600.0) is None
