# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The expected course of a flow: assumptions about it before the first step.

The lava of a source follows the steepest descent. Overlapping vents form one source. Across each
point of the path the terrain has a cross-section, which the lava fills to its normal depth: the
level at which the local balance of weight and drag carries the whole discharge,

    Q = K sum (level - ground)^3 (1 - 3 B / 2 + B^3 / 2) dy,  K = rho g tan(b) cos^4(b) / (3 mu),

with B the yield strength over the basal shear stress. An unconfined flow is at most as wide as the
steady flow of a point source down a plane (Smith 1973), on level ground at most as wide as the
flow of a point source onto a plane (Huppert 1982). On its way the lava loses heat by the
material's laws, and its viscosity and yield strength follow its temperature. The front advances by
the volume that its cross-sections take; lava colder than the solidus stops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
import math
from weakref import WeakKeyDictionary

import numpy as np

from lava_ros.effects import considered, Effects
from lava_ros.effects.column import normal_thickness
from lava_ros.effects.heat import host_temperature
from lava_ros.effects.laws import Rheology
from lava_ros.effects.scales import Columns
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.simulation.setup.descent import average_terrain, find_path, sample_profiles, slope_at

#: Quantile of the widths along the path: the narrow parts are those that must be resolved.
NARROW = 0.25

#: Maximum number of sources whose paths are followed, those with the largest discharges.
MAX_SOURCES = 3

#: Size of the cells of the path, in scales of the thickness: lava buries smaller features. The
#: terrain's cells are averaged to about that size.
_CELL = 4.0

#: Samples of a cross-section, an odd number.
_SAMPLES = 97

#: Width that the samples of an iteration cover, over the width of the previous iteration.
_COVERED = 2.0

#: Bisections of a level: the last is 1e-7 of the first interval.
_BISECTIONS = 24

#: Number of iterations of widths and temperatures, which depend on each other.
_ITERATIONS = 3

#: Minimum and maximum slope for computing a cross-section. Steeper parts of a path are walls, on
#: which the plan thickness of the law diverges.
_MIN_SLOPE, _MAX_SLOPE = 1e-3, 2.0

#: Width over (cot(b) x)^(3/7) (Q / K)^(1/7) of the steady flow down a plane at a distance x from
#: its source: 2 (14 / 3)^(3/7) (35 / 32)^(1/7), of h = H (1 - y^2 / Y^2) (Smith 1973).
_SMITH = 3.92

#: Diameter over (g Q^3 / (3 nu))^(1/8) t^(1/2) of a flow onto a plane (Huppert 1982, 2 x 0.715).
_HUPPERT = 1.43

#: Mean thickness of that flow over (3 mu Q / (rho g))^(1/4).
_MEAN_THICKNESS = 0.62


@dataclass(frozen=True)
class Course:
    """The expected course of a flow.

    Attributes:
        columns: Columns of lava, one for each cross-section that the front reaches.
        width: Width of the flow of the largest source, the lower quartile along the path [m].
        thickness: Median thickness of that flow, weighted by volume [m].
        fall: Largest difference of elevation between a source and the end of its path [m].
        reynolds: Reynolds number rho u h / mu that 90 % of the volume does not exceed.
        cooled: Median fraction of the way from the temperature at the vent to the solidus of that
            flow, weighted by volume; 0 without a solidus.
        slope: Slope of the ground below that flow that 90 % of its volume does not exceed, rise
            over run.
        discharge: Mean discharge of its source while it erupts [m3/s].
        temperature: Temperature at its source [K].
        emitted: Volume that all vents emit up to the horizon [m3].
    """

    columns: Columns
    width: float
    thickness: float
    fall: float
    reynolds: float
    cooled: float
    slope: float
    discharge: float
    temperature: float
    emitted: float

    def thickness_of(self, volume: float) -> float:
        """Return the thickness of the flow [m] once it has a volume [m3].

        Lava is at most as thick as a hemisphere of its volume, however stiff it is.
        """
        return min(self.thickness, (1.5 * volume / math.pi) ** (1.0 / 3.0))


@dataclass(frozen=True)
class _Source:
    """Vents that overlap.

    ``places`` are the ends of their lines [m], shape [ends, 2], ``radius`` is their largest
    radius [m], ``discharge`` the peak of their sum and ``mean`` its mean while they erupt
    [m3/s], ``volume`` their emission up to the horizon [m3], and ``temperature`` that of the
    hottest vent [K].
    """

    places: np.ndarray
    radius: float
    discharge: float
    volume: float
    temperature: float
    mean: float


#: Courses found so far, by scene, and by effects, horizon [s] and limit of the mobility [m/s].
_found = WeakKeyDictionary[Scene, dict[tuple[Effects, float, float], Course | None]]()


def course_of(
    scene: Scene, effects: Effects | None = None, *, horizon: float, mobility: float = math.inf
) -> Course | None:
    """Return the expected course of the flow; None without a discharge.

    Args:
        scene: The scene.
        effects: Effects whose laws the lava follows, by default all that the scene has.
        horizon: Time at which the course ends [s].
        mobility: ``Accuracy.mobility_limit`` [m/s], infinite without one.
    """
    effects = considered(scene) if effects is None else effects
    courses = _found.setdefault(scene, {})
    key = effects, horizon, mobility
    if key not in courses:
        courses[key] = _find_course(scene, effects, horizon, mobility)
    return courses[key]


def _find_course(
    scene: Scene, effects: Effects, horizon: float, mobility: float
) -> Course | None:
    sources = _sources(scene, horizon)[:MAX_SOURCES]
    if not sources:
        return None
    paths = [_follow(scene, effects, source, horizon, mobility) for source in sources]
    largest = paths[0][0]
    thickness = largest.quantile(largest.thickness, 0.5)
    width = largest.quantile(largest.width, NARROW)
    columns = Columns(*(
        np.concatenate([getattr(path, item.name) for path, _ in paths])
        for item in fields(Columns)
    ))
    momentum = scene.lava.density * columns.speed * columns.thickness
    rheology = Rheology(scene.lava, effects)
    viscosity = [rheology.viscosity_at(value) for value in columns.temperature.tolist()]
    reynolds = columns.quantile(momentum / viscosity, 0.9)
    hot, solidus = sources[0].temperature, scene.lava.solidus
    cold = largest.quantile(largest.temperature, 0.5)
    cooled = (hot - cold) / (hot - solidus) if 0.0 < solidus < hot else 0.0
    return Course(
        columns, width, thickness, max(fall for _, fall in paths), reynolds, cooled,
        largest.quantile(largest.ground_slope, 0.9), sources[0].mean, hot,
        sum(vent.volume_between(0.0, horizon) for vent in scene.vents),
    )


def _sources(scene: Scene, horizon: float) -> list[_Source]:
    """Group the vents with a discharge into sources, the one with the largest discharge first.

    Two vents overlap if the distance of their lines is no more than the sum of their radii, or
    one cell.
    """
    vents = [vent for vent in scene.vents if vent.volume_between(0.0, horizon) > 0.0]
    lines = [(vent.position, vent.end or vent.position) for vent in vents]
    starts, ends = np.array(lines, dtype=np.float64).reshape(-1, 2, 2).swapaxes(0, 1)
    radii = np.array([vent.radius for vent in vents])
    waiting, sources = set(range(len(vents))), []
    while waiting:
        numbers, added = set[int](), {min(waiting)}
        while added:
            numbers |= added
            waiting -= added
            others = np.array(sorted(waiting), dtype=int)
            near = np.zeros(len(others), dtype=bool)
            for number in added:
                gap = _distance(starts[number], ends[number], starts[others], ends[others])
                near |= gap <= np.maximum(radii[number] + radii[others], scene.terrain.resolution)
            added = set(others[near].tolist())
        chosen = sorted(numbers)
        members = [vents[number] for number in chosen]
        volume = sum(vent.volume_between(0.0, horizon) for vent in members)
        discharges = _discharges(members, horizon)
        sources.append(_Source(
            places=np.concatenate([starts[chosen], ends[chosen]]),
            radius=float(radii[chosen].max()),
            discharge=max(discharge for discharge, _ in discharges),
            volume=volume,
            temperature=max(vent.temperature for vent in members),
            mean=volume / math.fsum(time for discharge, time in discharges if discharge > 0.0),
        ))
    return sorted(sources, key=lambda source: source.discharge, reverse=True)


def _distance(
    start: np.ndarray, end: np.ndarray, starts: np.ndarray, ends: np.ndarray
) -> np.ndarray:
    """Return the distances of a line from other lines [m], shape [lines]; too large if they cross.

    Only crossing fissures have crossing lines, and they are not meant as one source.
    """

    def to_line(places: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        along = other - one
        length = np.maximum((along**2).sum(axis=-1), 1e-12)
        fraction = np.clip(((places - one) * along).sum(axis=-1) / length, 0.0, 1.0)
        return np.hypot(*np.moveaxis(places - one - fraction[..., None] * along, -1, 0))

    return np.min([
        to_line(start, starts, ends), to_line(end, starts, ends),
        to_line(starts, start, end), to_line(ends, start, end),
    ], axis=0)


def _discharges(vents: Sequence[Vent], horizon: float) -> list[tuple[float, float]]:
    """Return each constant sum of the vents' discharges [m3/s] up to a time, and how long [s]."""
    changes = {time for vent in vents for time, _ in vent.series if 0.0 < time < horizon}
    return [
        (sum(vent.discharge_at(start) for vent in vents), end - start)
        for start, end in pairwise(sorted({0.0, horizon, *changes}))
    ]


def _follow(
    scene: Scene, effects: Effects, source: _Source, horizon: float, mobility: float
) -> tuple[Columns, float]:
    """Follow the lava of a source; return its columns, and its descent [m]."""
    lava, weight = scene.lava, scene.lava.density * scene.gravity
    rheology = Rheology(lava, effects)
    viscosity = rheology.viscosity_at(source.temperature)
    scale = (3.0 * viscosity * source.discharge / weight) ** 0.25
    terrain = average_terrain(scene.terrain, round(_CELL * scale / scene.terrain.resolution))
    x0, y0, x1, y1 = terrain.extent
    level = _HUPPERT * (weight * source.discharge**3 / (3.0 * viscosity)) ** 0.125
    level = max(level * math.sqrt(horizon), 2.0 * source.radius)
    level = min(level, math.hypot(x1 - x0, y1 - y0))
    path, height = find_path(terrain, tuple(source.places.mean(axis=0).tolist()))
    if len(path) < 3:
        slope = slope_at(scene.terrain, source.places.mean(axis=0))
        return _on_level_ground(source, scale, level, slope, effects), 0.0
    steps = np.hypot(*np.diff(path, axis=0).T)
    step = 0.5 * (steps[1:] + steps[:-1])
    along = path[2:] - path[:-2]
    along /= np.hypot(*along.T)[:, None]
    slope = np.maximum((height[:-2] - height[2:]) / (2.0 * step), _MIN_SLOPE)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    # lava from a row of vents or a fissure is at least as wide as the row
    spread = across @ source.places.T
    extent = np.ptp(spread, axis=1) + 2.0 * source.radius
    drop = np.minimum(slope, _MAX_SLOPE)
    # cos^2 b: the stress at the base is rho g h tan b cos^2 b, the speed that times h cos^2 b
    square = normal_thickness(np.ones_like(slope), drop, effects) ** 2
    pull = drop * square
    distance = np.cumsum(step)
    temperature, width = np.full(len(step), source.temperature), np.full(len(step), np.inf)
    age, mean = np.zeros(len(step)), np.full(len(step), scale)
    for _ in range(_ITERATIONS):
        mu = np.array([rheology.viscosity_at(value) for value in temperature.tolist()])
        across = normal_thickness(mean, drop, effects)
        mu = np.maximum(mu, weight * across**2 / (3.0 * mobility))
        flux = 3.0 * mu * source.discharge / (weight * pull * square)
        strength = np.array([
            rheology.strength_at(*column)
            for column in zip(temperature.tolist(), across.tolist(), age.tolist(), strict=True)
        ])
        widest = _SMITH * (distance / slope) ** (3.0 / 7.0) * flux ** (1.0 / 7.0)
        widest = np.minimum(np.maximum(widest, extent), max(level, float(extent.max())))
        widest = np.minimum(widest, _COVERED * width)
        width, area, thickness = _normal_depth(
            terrain, path[1:-1], along, widest, flux, strength / (weight * pull)
        )
        speed = source.discharge / area
        # the surface that loses heat is as wide as the flow
        mean = area / width
        temperature, age = _cooled_on_the_way(
            scene, effects, source.temperature, mean, drop, speed, step
        )
        # solid lava is not stiffer: the first section has lava even if it is that cold
        temperature = np.maximum(temperature, lava.solidus)
    is_liquid = np.minimum.accumulate(temperature) > lava.solidus
    is_liquid[0] = True
    filled = np.minimum(np.cumsum(area * step), source.volume)
    reached = filled < source.volume
    reached[0] = True
    count = int((is_liquid & reached).sum())
    columns = Columns(
        volume=np.diff(filled, prepend=0.0),
        thickness=thickness,
        normal_thickness=normal_thickness(thickness, slope, effects),
        slope=np.maximum(slope, thickness / (distance[count - 1] + scale)),
        ground_slope=slope,
        temperature=temperature,
        speed=speed,
        width=width,
    )
    columns = Columns(*(getattr(columns, item.name)[:count] for item in fields(Columns)))
    return columns, float(height[0] - height[count])


def _on_level_ground(
    source: _Source, scale: float, width: float, ground_slope: float, effects: Effects
) -> Columns:
    """Return the column of a flow that spreads as if on level ground, where no path leads away."""
    radius, thickness = 0.5 * width, _MEAN_THICKNESS * scale
    values = {
        'volume': source.volume,
        'thickness': thickness,
        'normal_thickness': normal_thickness(thickness, ground_slope, effects),
        'slope': max(thickness / radius, ground_slope),
        'ground_slope': ground_slope,
        'temperature': source.temperature,
        'speed': source.discharge / (2.0 * math.pi * radius * thickness),
        'width': width,
    }
    return Columns(**{name: np.array([value]) for name, value in values.items()})


def _cooled_on_the_way(
    scene: Scene, effects: Effects, temperature: float, thickness: np.ndarray,
    slope: np.ndarray, speed: np.ndarray, step: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return temperature [K] and age [s] of lava at the end of each step [m] of its path."""
    cooled = host_temperature(scene, effects)
    time = step / speed
    age, reached = np.cumsum(time), []
    columns = np.column_stack([
        normal_thickness(thickness, slope, effects), age - time, slope * speed, speed, time
    ])
    for across, begun, drop, u, duration in columns.tolist():
        temperature = cooled(
            normal_thickness=across, temperature=temperature, age=begun, drop=drop, speed=u,
            step=duration,
        )
        reached.append(temperature)
    return np.array(reached), age


def _normal_depth(
    terrain: Terrain, points: np.ndarray, along: np.ndarray, widest: np.ndarray, flux: np.ndarray,
    still: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return width [m], area [m2] and thickness [m] of the lava in cross-sections of the terrain.

    They are at ``points`` [m] of the path, whose direction there is ``along``, both of shape
    [sections, 2], and at most ``widest`` wide [m]. ``flux`` is the discharge over the mobility
    [m4]: the integral of depth cubed, reduced by the yield strength. Lava up to ``still`` deep
    [m] does not yield. The thickness is the mean weighted by volume.
    """
    offset = widest[:, None] * np.linspace(-0.5, 0.5, _SAMPLES)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    ground, _ = sample_profiles(terrain, points, across, offset)
    middle = _SAMPLES // 2
    # there is lava where no higher ground lies between a sample and the path
    ground[:, middle:] = np.maximum.accumulate(ground[:, middle:], axis=1)
    ground[:, : middle + 1] = np.maximum.accumulate(ground[:, middle::-1], axis=1)[:, ::-1]
    cell = widest / _SAMPLES
    low = ground[:, middle].copy()
    # upper bound: the whole flux through one sample
    high = low + np.cbrt(flux / cell) + 1.5 * still
    for _ in range(_BISECTIONS):
        level = 0.5 * (low + high)
        depth = np.maximum(level[:, None] - ground, 0.0)
        held = np.minimum(still[:, None], depth)
        moving = (depth - held) ** 2 * (depth + 0.5 * held)
        is_more = moving.sum(axis=1) * cell > flux
        low, high = np.where(is_more, low, level), np.where(is_more, level, high)
    depth = np.maximum(high[:, None] - ground, 0.0)
    area = depth.sum(axis=1)
    return (depth > 0.0).sum(axis=1) * cell, area * cell, (depth**2).sum(axis=1) / area
