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

#: Relative errors. A bound is about 1.5 times the error measured on a CPU (docs/accuracy/cpu.csv,
#: `lava verify --preset P`), or more if that error is small by chance: a change in any digit moves
#: fronts by a part of a spacing. These are the sources of the errors:
#:
#: sheet: density summed over the lattice of particles; herschel_bulkley, material_laws: the same,
#:     amplified by the power of the thickness and by the yield strength. critical_thickness: the
#:     same, and the bisection.
#: bingham_dome, ridge: smoothing of the front; less than 0.1 % of the way remains after
#:     1e4 mu / tau_y.
#: green: the support is fixed, so draft has one particle for 2 thicknesses, and errs by 37 %.
#: channel: solve: the particles across half of the channel, 5 to 8, 10 to 15, 20 to 30; green: the
#:     same, and from standard on the cut-off at 6 / k.
#: pond: at rest particles still change places in the deep, at speeds that vary by chance; with the
#:     balanced gradient of the reference only the error of the thin edge is left.
#: radiating_sheet, latent_heat: the thickness. ground, crust: their laws, whatever the spacing.
#: fixed_volume, constant_flux, plane_fixed_area: smoothing of the front; the scatter is that of
#:     the lattice, and with a flux the vent adds noise of a part of a spacing.
#: dam_break: the front is 5, 7 and 10 spacings from the dam; passed: one column of particles more
#:     or less is 2, 1.5 and 1.1 %.
#: slope_fixed_area: smoothing, then the terms that the solution neglects, 0.2 run-outs of 60.
#: slope_flux: a front advances by rows of particles. look_ahead: the same, and half of the time
#:     between two looks: 0.15 % of the arrival time, or of the time the front needs for a cell.
#: lister: the spacing at the thin edge, and the two digits of the reference. At draft, x at 20 T
#:     is one of two cells of the map by chance, 1.5 or 3.7 %; y is 1.5 % at standard on a GPU.
#: smith: the kernel radius, a third, a sixth and a twelfth of the half-width, and chance at the
#:     edge, about 0.3 % in the spread at standard; the solution itself neglects 0.2 % by then.
#: freezing_lens: at the edge of the fluid part the sum over the neighbours is too small, so the
#:     lava freezes too early.
#: inertial_sheet: the time step, a fiftieth of the relaxation time over the refinement. ritter:
#:     the tip, which thins out to less than a particle. stoker: the ends of the plateau, which are
#:     smoothed over the width of a kernel.
#: thacker: period: the edge, and a percent of the energy lost per period to the dissipation that
#:     bores need, by particles that change places; growth: the leapfrog, see STEPS in inertia.py.
#: viscous_heating: warming: density summed over the lattice; heat of spreading: the slope at the
#:     end of a step is used for all of it, and the kernel lowers the centre. conduction: heat:
#:     rounding.
#: cooling_current: power: heat is still being stored.
#: silicone_oil: mean plus three standard deviations of 16 runs (6 at fine) whose discharges differ
#:     by 1e-6; what the paper leaves open is 4.7 % of the temperature at 0.5 radii.
#:
#: A preset in ``STAND_INS`` is held to the bounds of another where it has none of its own.
BOUNDS: dict[str, dict[str, dict[str, float]]] = {
    'sheet': {
        'speed at 3 degrees': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
        'speed at 10 degrees': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
        'speed at 25 degrees': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
    },
    'herschel_bulkley': {
        'speed, Bingham': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
        'speed, power law, n 0.5': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
        'speed, n 0.5': {'draft': 0.0015, 'standard': 0.0015, 'fine': 0.0015},
        'speed, n 1': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
        'speed, n 2': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
    },
    'critical_thickness': {
        'thickness at 3 degrees': {'draft': 0.0005, 'standard': 0.0005, 'fine': 0.0005},
        'thickness at 10 degrees': {'draft': 0.0005, 'standard': 0.0005, 'fine': 0.0005},
        'thickness at 25 degrees': {'draft': 0.0005, 'standard': 0.0005, 'fine': 0.0005},
        'creep of 0.99 of it': {'draft': 1e-9, 'standard': 1e-9, 'fine': 1e-9},
    },
    'material_laws': {
        'VFT, 1400 K': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
        'VFT, 1200 K': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
        'einstein-roscoe': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
        'maron-pierce': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
        'strength': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
    },
    'bingham_dome': {
        'radius': {'draft': 0.003, 'standard': 0.0015, 'fine': 0.0015},
        'profile': {'draft': 0.012, 'standard': 0.005, 'fine': 0.003},
        'edge': {'draft': 0.008, 'standard': 0.003, 'fine': 0.002},
    },
    'ridge': {
        'half-width': {'draft': 0.006, 'standard': 0.006, 'fine': 0.005},
        'profile': {'draft': 0.015, 'standard': 0.01, 'fine': 0.005},
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
        'speed after an hour': {'draft': 7e-4, 'standard': 7e-4, 'fine': 4e-4, 'reference': 5e-5},
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
        'edge': {'draft': 0.015, 'standard': 0.006, 'fine': 0.005},
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
        'passed': {'draft': 0.04, 'standard': 0.015, 'fine': 0.012},
    },
    'slope_fixed_area': {
        'front': {'draft': 0.01, 'standard': 0.006, 'fine': 0.004},
    },
    'slope_flux': {
        'arrival': {'draft': 0.018, 'standard': 0.01, 'fine': 0.006},
        'speed': {'draft': 0.02, 'standard': 0.015, 'fine': 0.015},
    },
    'look_ahead': {
        'arrival': {'draft': 0.01, 'standard': 0.008, 'fine': 0.006},
        'worst cell': {'draft': 0.033, 'standard': 0.01, 'fine': 0.007},
    },
    'lister': {
        'x at 20 T': {'draft': 0.055, 'standard': 0.015, 'fine': 0.006},
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
    'ground': {
        'temperature after 1 h': {'draft': 0.002, 'standard': 0.002, 'fine': 0.002},
        'temperature after 10 h': {'draft': 0.005, 'standard': 0.005, 'fine': 0.005},
        'temperature after 100 h': {'draft': 0.009, 'standard': 0.009, 'fine': 0.009},
    },
    'crust': {
        'temperature after 1 h': {'draft': 0.005, 'standard': 0.005, 'fine': 0.005},
        'temperature after 10 h': {'draft': 0.03, 'standard': 0.03, 'fine': 0.03},
        'temperature after 100 h': {'draft': 0.015, 'standard': 0.015, 'fine': 0.015},
    },
    'latent_heat': {
        'temperature after 1 h': {'draft': 2e-4, 'standard': 2e-4, 'fine': 2e-4},
        'temperature after 10 h': {'draft': 3e-4, 'standard': 3e-4, 'fine': 3e-4},
        'temperature after 100 h': {'draft': 1e-4, 'standard': 1e-4, 'fine': 1e-4},
    },
    'viscous_heating': {
        'warming': {'draft': 0.001, 'standard': 0.001, 'fine': 0.001},
        'heat of spreading': {'draft': 0.08, 'standard': 0.07, 'fine': 0.06},
    },
    'conduction': {
        'profile': {'draft': 0.004, 'standard': 0.002, 'fine': 0.0015},
        'heat': {'draft': 1e-6, 'standard': 1e-6, 'fine': 1e-6},
    },
    'cooling_current': {
        'temperature at 0.5 thermal radii': {'draft': 0.005, 'standard': 0.002, 'fine': 0.001},
        'temperature at 1 thermal radii': {'draft': 0.005, 'standard': 0.003, 'fine': 0.002},
        'power of the surface': {'draft': 0.025, 'standard': 0.025, 'fine': 0.025},
    },
    'silicone_oil': {
        'power at 1 thermal radii': {'draft': 0.026, 'standard': 0.004, 'fine': 0.004},
        'power at 2 thermal radii': {'draft': 0.002, 'standard': 0.002, 'fine': 0.002},
        'power at 3 thermal radii': {'draft': 0.002, 'standard': 0.0015, 'fine': 0.0015},
        'temperature at 0.5 thermal radii': {'draft': 0.004, 'standard': 0.002, 'fine': 0.0015},
        'temperature at 1 thermal radii': {'draft': 0.005, 'standard': 0.001, 'fine': 0.001},
        'temperature at 1.5 thermal radii': {'draft': 0.002, 'standard': 0.001, 'fine': 0.001},
        'front': {'draft': 0.01, 'standard': 0.01, 'fine': 0.007},
    },
    'freezing_lens': {
        'frozen after 0.3 of the time': {'draft': 0.035, 'standard': 0.03, 'fine': 0.015},
        'frozen after 0.6 of the time': {'draft': 0.08, 'standard': 0.05, 'fine': 0.03},
        'frozen after 0.9 of the time': {'draft': 0.17, 'standard': 0.065, 'fine': 0.03},
        'frozen in the end': {'draft': 1e-9, 'standard': 1e-9, 'fine': 1e-9},
        'deposit': {'draft': 0.04, 'standard': 0.013, 'fine': 0.007},
    },
    'inertial_sheet': {
        'speed after half': {'draft': 0.02, 'standard': 0.012, 'fine': 0.006},
        'speed after one': {'draft': 0.016, 'standard': 0.01, 'fine': 0.005},
        'speed after three': {'draft': 0.005, 'standard': 0.003, 'fine': 0.002},
    },
    'ritter': {
        'thickness': {'draft': 0.045, 'standard': 0.028, 'fine': 0.018},
    },
    'stoker': {
        'thickness': {'draft': 0.04, 'standard': 0.03, 'fine': 0.018},
        'bore': {'draft': 0.02, 'standard': 0.01, 'fine': 0.01},
    },
    'thacker': {
        'period': {'draft': 0.005, 'standard': 0.005, 'fine': 0.005},
        'loss a period': {'draft': 0.018, 'standard': 0.016, 'fine': 0.016},
        'energy growth': {'draft': 6e-5, 'standard': 3e-5, 'fine': 3e-5},
    },
}


#: The reference takes too long on a CPU to be measured there: it is no worse than fine.
STAND_INS = {'reference': 'fine'}

#: Presets that have bounds: one that only shows how it was done before has none.
BOUNDED_PRESETS = ('draft', 'standard', 'fine', 'reference')


def bound(preset: str, case: str, quantity: str) -> float:
    """Largest relative error that a quantity of a case may have at a preset.

    Raises:
        LavaError: The preset, the case or the quantity has no bound.
    """
    validation.choice('preset', preset, BOUNDED_PRESETS)
    quantities = BOUNDS.get(case, {})
    validation.choice(f'bounds.{case}', quantity, quantities)
    limits = quantities[quantity]
    return limits[preset if preset in limits else STAND_INS[preset]]
