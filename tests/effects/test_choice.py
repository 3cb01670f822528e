# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Numbers that decide about effects, and the stated errors of leaving an effect off."""

from dataclasses import replace
import math
import re

import numpy as np
import pytest

from lava_ros.effects import EFFECTS
from lava_ros.effects.laws import rheology_of
from lava_ros.effects.scales import Columns, footprint_change, Scales, thickness_change
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.selection import decide_by, MIN_EMITTED

DECIDED = [name for name, effect in EFFECTS.items() if effect.number is not None]

#: Lava with every property on which a number may depend.
RICH = Lava.paper(
    viscosity=1e4, arrhenius=0.04, yield_strength=100.0, yield_rate=0.05, solidus=1223.0,
    liquidus=1473.0, latent_heat=3.5e5, crystal_law='einstein-roscoe', crystals=0.4,
)

HOT = 1423.0


def scales(lava, rest, **columns):
    """Return the scales of columns that have cooled to temperatures [K] at rest."""
    rest = np.atleast_1d(np.asarray(rest, dtype=float))
    one = np.ones_like(rest)
    values = {
        'volume': one, 'thickness': 2.0 * one, 'normal_thickness': 2.0 * one,
        'slope': 0.1 * one, 'ground_slope': 0.1 * one, 'temperature': HOT * one,
        'speed': 0.1 * one, 'width': 50.0 * one, **columns,
    }
    vent = Vent((20.0, 20.0), 1.0, temperature=HOT)
    scene = Scene(Terrain(np.zeros((4, 4)), 10.0), (vent,), lava)
    return Scales(
        scene=scene, rheology=rheology_of(lava), columns=Columns(**values),
        vent_temperature=HOT, rest_temperature=rest, fall=10.0,
        duration=3600.0, is_extended=True, age_of_crust=0.0,
    )


@pytest.mark.parametrize('name', DECIDED)
def test_cost_follows_from_the_admitted_error(name):
    """The change of area follows from the percentage in the text."""
    effect = EFFECTS[name]
    assert math.isfinite(effect.cost)
    if effect.admits.startswith('nothing'):
        assert effect.cost == 0.0
        return
    assert effect.threshold > 0.0 and effect.cost > 0.0
    found = re.search(r'([0-9.]+) % of (the speed|the front|the width)', effect.admits)
    fraction = float(found[1]) / 100.0
    expected = footprint_change(fraction) if found[2] == 'the speed' else fraction
    assert effect.cost == pytest.approx(expected)
    expected = thickness_change(fraction) if found[2] == 'the speed' else fraction
    assert effect.thickness_cost == pytest.approx(expected)


def test_effects_that_admit_no_error():
    found = {name for name in DECIDED if not (EFFECTS[name].cost or EFFECTS[name].kind)}
    assert found == {'power_law', 'vft', 'green', 'solidification'}


@pytest.mark.parametrize('change', [0.01, 0.05])
@pytest.mark.parametrize('wide', [0.0, -0.25], ids=['channel', 'valley'])
def test_area_changes_by_no_more_than_admitted(change, wide):
    """Two rectangles whose lengths and widths are powers of the mobility k.

    In a channel the length is k^(1/3) at a constant width; in a valley with even sides the length
    is k^(1/2) and the width k^(-1/4).
    """
    longer = (1.0 + change) ** (0.5 if wide else 1.0 / 3.0)
    narrower = (1.0 + change) ** wide
    both = min(1.0, longer) * min(1.0, narrower)
    either = 1.0 + longer * narrower - both
    assert 0.3 * change < 1.0 - both / either <= footprint_change(change)


def test_heat_is_weighted_by_its_effect_on_the_flow():
    """Weights: 1/3 of the change of ln viscosity, 4/9 for the strength, or the heat itself."""
    plain = replace(RICH, arrhenius=0.0, crystals=0.0, yield_rate=0.0)
    warmth = scales(plain, HOT).warmth
    assert scales(plain, HOT).matters(0.01) == pytest.approx(0.01)
    stiff = scales(replace(plain, arrhenius=0.04), HOT)
    assert stiff.matters(0.01) == pytest.approx(0.04 * 0.01 * warmth / 3.0, rel=1e-3)
    strong = scales(replace(plain, arrhenius=0.04, yield_rate=0.05), HOT)
    assert strong.matters(0.01) == pytest.approx(0.05 * 0.01 * warmth * 4.0 / 9.0, rel=1e-3)


@pytest.mark.parametrize('packing', [0.5, 0.6, 0.8])
def test_number_of_crystals_is_the_log_of_the_viscosity_ratio(packing):
    lava = replace(RICH, packing=packing)
    rest = np.array([1500.0, 1440.0, 1350.0, 1230.0])
    found = EFFECTS['crystals'].number(scales(lava, rest))
    bare = replace(lava, crystals=0.0)
    expected = [math.log(lava.viscosity_at(t) / bare.viscosity_at(t)) for t in rest]
    assert found == pytest.approx(expected, abs=1e-12)
    assert found[0] == 0.0 and found[1] > 0.03


def test_number_of_latent_heat_below_the_liquidus():
    lava = replace(RICH, arrhenius=0.0, crystals=0.0, yield_rate=0.0)
    rest = np.array([1480.0, 1473.0, 1472.0, 1450.0, 1300.0, 1223.0, 900.0])
    found = EFFECTS['latent_heat'].number(scales(lava, rest)) * scales(lava, rest).warmth
    whole = lava.latent_heat / lava.specific_heat
    assert found[:2] == pytest.approx([0.0, 0.0])
    # latent heat cannot warm lava by more than it has cooled
    assert found[2:4] == pytest.approx([1.0, 23.0])
    assert found[4] == pytest.approx(min(whole * 173.0 / 250.0, 173.0))
    assert found[5:] == pytest.approx([min(whole, 250.0), min(whole, 573.0)])


def test_laws_are_interpolated_accurately():
    temperature = np.linspace(1101.0, 1439.0, 50)
    found = scales(RICH, temperature).law(RICH.yield_strength_at, temperature)
    assert found == pytest.approx([RICH.yield_strength_at(t) for t in temperature], rel=1e-9)
    melt = replace(RICH, crystals=0.0, arrhenius=0.0, vft_b=6500.0, vft_c=600.0)
    found = scales(melt, temperature).law(melt.viscosity_at, temperature)
    assert found == pytest.approx([melt.viscosity_at(t) for t in temperature], rel=1e-3)


def test_little_of_the_lava_switches_no_effect_on():
    """The thin lava of an early pile is not the flow; any frozen column is ground at once."""
    lava = Lava.paper(yield_strength=1e4, solidus=1400.0, arrhenius=0.04)
    late = replace(scales(lava, [1300.0]), is_measured=True)
    late = replace(late, columns=replace(late.columns, temperature=np.array([1350.0])))
    names = ('yielding', 'solidification', 'helmholtz')
    for fraction in (0.5 * MIN_EMITTED, MIN_EMITTED):
        decisions = decide_by(replace(late, emitted=fraction), {}, Accuracy(), names=names)
        found = {item.name: item.is_on for item in decisions}
        assert found == {
            'yielding': fraction == MIN_EMITTED, 'solidification': True, 'helmholtz': False,
        }


def test_measured_fraction_is_that_of_the_volume_at_the_horizon():
    terrain = Terrain(np.zeros((20, 20)), 10.0)
    vent = Vent((100.0, 100.0), ((0.0, 3.0), (100.0, 1.0), (200.0, 0.0)), radius=20.0)
    simulation = Simulation(
        Scene(terrain, (vent,)), device='cpu', horizon=1000.0, accuracy=Accuracy(spacing=10.0)
    )
    simulation.advance(100.0)
    measured = simulation.measure_scales()
    assert measured is not None
    assert measured.emitted == pytest.approx(0.75)
