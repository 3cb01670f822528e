# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Error bounds for each preset, case and quantity."""

from lava_ros import validation

Limits = float | tuple[float, ...]


def _after_hours(*limits: float) -> dict[str, Limits]:
    return {f'temperature after {10**power} h': limit for power, limit in enumerate(limits)}


#: Relative errors. A bound is about 1.5 times the error measured on a CPU (docs/accuracy/cpu.csv,
#: `lava check solver --preset P`), or more if that error is small by chance: a change in any digit
#: moves fronts by a part of a spacing. A quantity has one bound, or one for each preset starting
#: with draft. The reference takes too long on a CPU: where it has no bound of its own, that of
#: fine applies. Errors come from the spacing, the smoothing of fronts over a kernel radius, and
#: where #: named:
#:
#: herschel_bulkley, material_laws: the error of sheet, amplified by the power of the thickness and
#:     by the yield strength.
#: green, channel: the parabolic profile (0.5 % below Stokes flow at 4 h, 2.8 % at W/h 1), and the
#:     cut-off at 6 / k from 8 h and W/h 6 on. In the channel the particles across have an error of
#:     the other sign.
#: pond: particles still change places in the deep, except with the balanced gradient of the
#:     reference, where the error of the thin edge remains.
#: radiating_sheet, latent_heat: the thickness. ground, crust, steep_sheet: their laws, whatever
#:     the spacing. The law of crust has 1.9 % after an hour. Steps of ten minutes with a midpoint
#:     in the first step hid that by chance (0.1 %); steps of a minute had 1.8 %.
#: dam_break: the front is 5, 7 and 10 spacings from the dam; passed: one column of particles more
#:     or less is 2, 1.5 and 1.1 %.
#: slope_fixed_area: also the terms that the solution neglects. slope_flux, look_ahead: whole rows
#:     of particles, at the ends of steps.
#: lister: also the two digits of the reference. At draft, x at 20 T is one of two cells of the map
#:     by chance, 1.5 or 3.7 %; y is 1.5 % at standard on a GPU.
#: smith: the kernel radius, a third, a sixth and a twelfth of the half-width, and chance at the
#:     edge; the solution itself neglects 0.2 % by then.
#: freezing_lens: at the edge of the fluid part the sum over the neighbours is too small, so the
#:     lava freezes too early.
#: inertial_sheet: the time step, a fiftieth of the relaxation time over the refinement. ritter:
#:     the tip, which thins out to less than a particle.
#: thacker: a percent of the energy lost per period to the dissipation that bores need; growth: the
#:     leapfrog, see STEPS in inertia.py.
#: viscous_heating: the slope at the end of a step is used for all of it, and the kernel lowers the
#:     centre. conduction: heat: rounding. cooling_current: power: heat is still being stored.
#: insulated_sheet: the place at which lava leaves the fissure, to a part of the kernel radius: the
#:     cooling changes by 3 % of its value in a metre.
#: cooling_sheet: noise of the particles, and the scatter of temperatures at the source.
#: cooling_plane: margins 2 m thick and at rest; fingers of hot lava at the front, by chance: 4.2
#:     to 5.2 % at draft for discharges that differ by 1e-4; the reference, which changes by 4 %
#:     from cells of 2.5 m to 1.25 m. Cells count that lava covers at least half: maps also show
#:     lava in cells that it touches, 2 % more of them.
#: silicone_oil: mean plus three standard deviations of 16 runs (6 at fine) whose discharges differ
#:     by 1e-6; power at 1 thermal radius: the spacing, of the first order. The uncertainty left by
#:     the paper is 4.7 % of the temperature at 0.5 radii.
BOUNDS: dict[str, dict[str, Limits]] = {
    'sheet': {f'speed at {slope} degrees': 0.001 for slope in (3, 10, 25)},
    'herschel_bulkley': {
        'speed, Bingham': 0.001, 'speed, power law, n 0.5': 0.001, 'speed, n 0.5': 0.0015,
        'speed, n 1': 0.001, 'speed, n 2': 0.001,
    },
    'critical_thickness': {
        **{f'thickness at {slope} degrees': 0.0005 for slope in (3, 10, 25)},
        'creep of 0.99 of it': 1e-9,
    },
    'crust_strength': {
        f'{days} days at {slope} degrees': 0.001 for days in (1, 46) for slope in (10, 30, 45)
    },
    'material_laws': {
        'VFT, 1400 K': 0.001, 'VFT, 1200 K': 0.001, 'einstein-roscoe': 0.001,
        'maron-pierce': 0.001, 'strength': 0.001,
    },
    'bingham_dome': {
        'radius': (0.003, 0.0015, 0.0015), 'profile': (0.012, 0.005, 0.003),
        'edge': (0.008, 0.003, 0.002),
    },
    'ridge': {'half-width': (0.006, 0.006, 0.005), 'profile': (0.015, 0.01, 0.005)},
    'green': {
        'response at 4 h': (0.19, 0.035, 0.035), 'response at 8 h': (0.023, 0.012, 0.012),
        'response at 20 h': 0.005,
    },
    'channel': {
        'helmholtz W/h 1': 0.04, 'helmholtz W/h 2.5': (0.008, 0.005, 0.005),
        'helmholtz W/h 5': (0.013, 0.007, 0.004), 'green W/h 6': (0.021, 0.01, 0.01),
    },
    'pond': {
        'speed after an hour': (7e-4, 7e-4, 4e-4, 5e-5),
        'flatness after an hour': (0.002, 0.0015, 0.0012),
        'speed at rest': (4e-5, 4e-5, 4e-5, 1e-6), 'flatness at rest': (0.002, 0.0015, 0.0012),
    },
    'radiating_sheet': {f'temperature after {hour} h': 0.0002 for hour in (1, 10, 24)},
    'fixed_volume': {
        'radius': (0.003, 0.001, 0.0008), 'profile': (0.015, 0.005, 0.003),
        'edge': (0.015, 0.006, 0.005), 'scatter': 0.0005,
    },
    'constant_flux': {
        'radius': (0.015, 0.008, 0.005), 'exponent': (0.015, 0.01, 0.01),
        'coefficient': (0.02, 0.01, 0.01),
    },
    'plane_fixed_area': {'front': (0.015, 0.006, 0.004), 'profile': (0.018, 0.01, 0.007)},
    'dam_break': {'front': (0.13, 0.06, 0.035), 'passed': (0.04, 0.015, 0.012)},
    'slope_fixed_area': {'front': (0.01, 0.006, 0.004)},
    'slope_flux': {'arrival': (0.018, 0.01, 0.006), 'speed': (0.02, 0.015, 0.015)},
    'look_ahead': {'arrival': (0.03, 0.02, 0.013), 'worst cell': (0.045, 0.025, 0.017)},
    'lister': {
        'x at 20 T': (0.055, 0.015, 0.006), 'y at 20 T': (0.06, 0.03, 0.015),
        'x at 50 T': (0.025, 0.015, 0.006), 'y at 50 T': (0.07, 0.03, 0.015),
        'x at 100 T': (0.026, 0.01, 0.006), 'y at 100 T': (0.08, 0.03, 0.015),
    },
    'smith': {
        'half-width': (0.05, 0.015, 0.01), 'spread': (0.03, 0.015, 0.01),
        'axis thickness': (0.016, 0.006, 0.004),
    },
    'ground': _after_hours(0.002, 0.005, 0.009),
    'crust': _after_hours(0.03, 0.03, 0.015),
    'insulation': _after_hours(0.001, 0.0005, 0.0005),
    'insulated_sheet': {
        'cooling after 300 s': (0.028, 0.01, 0.005),
        'cooling after 600 s': (0.08, 0.02, 0.016),
    },
    'latent_heat': _after_hours(2e-4, 3e-4, 1e-4),
    'steep_sheet': {
        **{f'cooling, {hours} h': 0.0003 for hours in (1, 10, 100)},
        'ground, 1 h': 0.0015, 'ground, 10 h': 0.006, 'ground, 100 h': 0.009,
        'crust, 1 h': 0.03, 'crust, 10 h': 0.03, 'crust, 100 h': 0.015,
    },
    'viscous_heating': {'warming': 0.001, 'heat of spreading': (0.08, 0.07, 0.06)},
    'conduction': {'profile': (0.004, 0.002, 0.0015), 'heat': 1e-6},
    'cooling_current': {
        'temperature at 0.5 thermal radii': (0.005, 0.002, 0.001),
        'temperature at 1 thermal radii': (0.005, 0.003, 0.002), 'power of the surface': 0.025,
    },
    'cooling_sheet': {
        'thickness, Newtonian': (0.005, 0.004, 0.004), 'thickness, Bingham': 0.005,
        'temperature, Newtonian': (0.018, 0.014, 0.01),
        'temperature, Bingham': (0.026, 0.018, 0.015),
    },
    'cooling_front': {
        'centre of mass': (0.018, 0.0105, 0.007), 'profile': (0.033, 0.03, 0.03),
    },
    'cooling_plane': {'footprint': 0.06, 'front': (0.025, 0.02, 0.015)},
    'silicone_oil': {
        'power at 1 thermal radii': (0.026, 0.014, 0.009),
        'power at 2 thermal radii': (0.0025, 0.002, 0.002),
        'power at 3 thermal radii': (0.002, 0.0015, 0.0015),
        'temperature at 0.5 thermal radii': (0.004, 0.002, 0.0015),
        'temperature at 1 thermal radii': (0.005, 0.001, 0.001),
        'temperature at 1.5 thermal radii': (0.002, 0.001, 0.001), 'front': (0.01, 0.01, 0.007),
    },
    'freezing_lens': {
        'frozen after 0.3 of the time': (0.035, 0.03, 0.015),
        'frozen after 0.6 of the time': (0.08, 0.05, 0.03),
        'frozen after 0.9 of the time': (0.17, 0.065, 0.03), 'frozen in the end': 1e-9,
        'deposit': (0.04, 0.013, 0.007),
    },
    'inertial_sheet': {
        'speed after half': (0.02, 0.012, 0.006), 'speed after one': (0.016, 0.01, 0.005),
        'speed after three': (0.005, 0.003, 0.002),
    },
    'ritter': {'thickness': (0.045, 0.028, 0.018)},
    'stoker': {'thickness': (0.04, 0.03, 0.018), 'bore': (0.02, 0.01, 0.01)},
    'thacker': {
        'period': 0.005, 'loss a period': (0.018, 0.016, 0.016),
        'energy growth': (6e-5, 3e-5, 3e-5),
    },
}

#: Presets that have bounds: a preset that only reproduces an older method has none.
BOUNDED_PRESETS = ('draft', 'standard', 'fine', 'reference')


def bound(preset: str, case: str, quantity: str) -> float:
    """Return the maximum relative error of a quantity of a case at a preset.

    Raises:
        LavaError: If the preset, the case or the quantity has no bound.
    """
    validation.choice('preset', preset, BOUNDED_PRESETS)
    quantities = BOUNDS.get(case, {})
    validation.choice(f'bounds.{case}', quantity, quantities)
    limits = quantities[quantity]
    if isinstance(limits, float):
        return limits
    return limits[min(BOUNDED_PRESETS.index(preset), len(limits) - 1)]
