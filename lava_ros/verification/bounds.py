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

"""How large an error may be, for each preset, case and quantity."""

from lava_ros import validation

#: Relative errors. Measured on a CPU with `lava verify --preset P`; a bound is about 1.5 times
#: what was measured, or more where that is small by chance: fronts move by a part of a spacing
#: when any digit changes. The largest quantities that were measured, in % (draft, standard, fine),
#: and what limits them:
#:
#: sheet: 0.04, 0.04, 0.04: the lattice's sum over its density.
#: green: 37, 0.6, 0.9: the support is fixed, so draft has a particle for each 2 thicknesses.
#: channel: solve 2.1, 0.6, 0.3: particles across half of the channel, 5 to 8, 10 to 15, 20 to 30;
#:     green 2.1, 0.98, 0.98: the same, and from standard on the cut at 6 / k.
#: pond: speed after an hour 0.009, 0.04, 0.008; at rest 3e-5, 0.0013: particles still change
#:     places in the deep, and chance says how fast; with the balanced gradient of the reference
#:     0.0014 and 8e-5, of the thin edge. Flatness 0.11, 0.09, 0.08; balanced 0.01.
#: radiating_sheet: 0.005, 0.005, 0.005: the thickness.
#: fixed_volume: radius 0.18, 0.06, 0.05; profile 0.98, 0.35, 0.16; edge 0.75, 0.38, 0.24:
#:     smoothing of the front. Scatter 0.02, 0.02, 0.02: the particles' lattice.
#: constant_flux: radius 0.7, 0.3, 0.2; exponent 0.3, 0.3, 0.4; coefficient 0.8, 0.4, 0.3: the
#:     same, and noise of a part of a spacing from the vent.
#: plane_fixed_area: front 0.9, 0.4, 0.2; profile 1.2, 0.7, 0.5: smoothing of the front.
#: dam_break: front 0.03, 4.0, 2.5: it is 4, 7 and 15 spacings from the dam, and draft is right by
#:     chance; passed 0.2, 0.2, 0.2, by chance: a column of particles more or less is 3, 1.5 and
#:     0.7.
#: slope_fixed_area: 0.5, 0.3, 0.2: smoothing, then what the solution leaves out, 0.2 run-outs of
#:     60.
#: slope_flux: arrival 1.2, 0.6, 0.3; speed 1.2, 0.4, 0.8: a front advances by rows of particles.
#: lister: x 1.7, 0.9, 0.3; y 4.7, 1.0, 0.5, and at standard 1.5 on a GPU: the spacing at the thin
#:     edge, and two digits of the reference.
#: smith: half-width 3.0, 0.8, 0.4; spread 0.6, 0.3, 0.1; axis 1.0, 0.4, 0.2: the kernel radius, a
#:     third, a sixth and a twelfth of the half-width, and chance at the edge, about 0.3 in the
#:     spread at standard; what the solution leaves out is 0.2, 0.2 and 0.2 by then.
#:
#: A preset in ``STAND_INS`` is held to the bounds of another where it has none of its own.
BOUNDS: dict[str, dict[str, dict[str, float]]] = {
    'sheet': {
        'speed at 3 degrees': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
        'speed at 10 degrees': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
        'speed at 25 degrees': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
    },
    'green': {
        'response at 4 h': {'draft': 0.6, 'standard': 0.02, 'fine': 0.02},
        'response at 8 h': {'draft': 0.1, 'standard': 0.012, 'fine': 0.012},
        'response at 20 h': {'draft': 0.015, 'standard': 0.005, 'fine': 0.005},
    },
    'channel': {
        'helmholtz W/h 1': {'draft': 0.035, 'standard': 0.01, 'fine': 0.01},
        'helmholtz W/h 2.5': {'draft': 0.02, 'standard': 0.01, 'fine': 0.01},
        'helmholtz W/h 5': {'draft': 0.03, 'standard': 0.01, 'fine': 0.01},
        'green W/h 6': {'draft': 0.035, 'standard': 0.01, 'fine': 0.01},
    },
    'pond': {
        'speed after an hour': {'draft': 4e-4, 'standard': 7e-4, 'fine': 4e-4, 'reference': 5e-5},
        'flatness after an hour': {'draft': 0.002, 'standard': 0.0015, 'fine': 0.0012},
        'speed at rest': {'draft': 4e-5, 'standard': 4e-5, 'fine': 4e-5, 'reference': 1e-6},
        'flatness at rest': {'draft': 0.002, 'standard': 0.0015, 'fine': 0.0012},
    },
    'radiating_sheet': {
        'temperature after 1 h': {'draft': 0.0002, 'standard': 0.0002, 'fine': 0.0002},
        'temperature after 10 h': {'draft': 0.0002, 'standard': 0.0002, 'fine': 0.0002},
        'temperature after 24 h': {'draft': 0.0002, 'standard': 0.0002, 'fine': 0.0002},
    },
    'fixed_volume': {
        'radius': {'draft': 0.003, 'standard': 0.001, 'fine': 0.0008},
        'profile': {'draft': 0.015, 'standard': 0.005, 'fine': 0.003},
        'edge': {'draft': 0.015, 'standard': 0.006, 'fine': 0.004},
        'scatter': {'draft': 0.0005, 'standard': 0.0005, 'fine': 0.0005},
    },
    'constant_flux': {
        'radius': {'draft': 0.015, 'standard': 0.005, 'fine': 0.005},
        'exponent': {'draft': 0.015, 'standard': 0.01, 'fine': 0.01},
        'coefficient': {'draft': 0.02, 'standard': 0.01, 'fine': 0.01},
    },
    'plane_fixed_area': {
        'front': {'draft': 0.015, 'standard': 0.006, 'fine': 0.004},
        'profile': {'draft': 0.018, 'standard': 0.01, 'fine': 0.007},
    },
    'dam_break': {
        'front': {'draft': 0.13, 'standard': 0.06, 'fine': 0.035},
        'passed': {'draft': 0.04, 'standard': 0.015, 'fine': 0.01},
    },
    'slope_fixed_area': {
        'front': {'draft': 0.01, 'standard': 0.006, 'fine': 0.004},
    },
    'slope_flux': {
        'arrival': {'draft': 0.018, 'standard': 0.01, 'fine': 0.006},
        'speed': {'draft': 0.02, 'standard': 0.015, 'fine': 0.015},
    },
    'lister': {
        'x at 20 T': {'draft': 0.03, 'standard': 0.015, 'fine': 0.006},
        'y at 20 T': {'draft': 0.06, 'standard': 0.03, 'fine': 0.015},
        'x at 50 T': {'draft': 0.025, 'standard': 0.015, 'fine': 0.006},
        'y at 50 T': {'draft': 0.07, 'standard': 0.03, 'fine': 0.015},
        'x at 100 T': {'draft': 0.026, 'standard': 0.01, 'fine': 0.006},
        'y at 100 T': {'draft': 0.08, 'standard': 0.03, 'fine': 0.015},
    },
    'smith': {
        'half-width': {'draft': 0.05, 'standard': 0.015, 'fine': 0.01},
        'spread': {'draft': 0.03, 'standard': 0.015, 'fine': 0.01},
        'axis thickness': {'draft': 0.016, 'standard': 0.006, 'fine': 0.004},
    },
}


#: The reference takes too long on a CPU to be measured there: it is no worse than fine.
STAND_INS = {'reference': 'fine'}

#: Presets that have bounds: one that only shows how it was done before has none.
BOUNDED_PRESETS = ('draft', 'standard', 'fine', 'reference')


def bound(preset: str, case: str, quantity: str) -> float:
    """Largest relative error that a quantity of a case may have at a preset.

    Raises:
        LavaError: There is no bound for it.
    """
    validation.choice('preset', preset, BOUNDED_PRESETS)
    quantities = BOUNDS.get(case, {})
    validation.choice(f'bounds.{case}', quantity, quantities)
    limits = quantities[quantity]
    return limits[preset if preset in limits else STAND_INS[preset]]
