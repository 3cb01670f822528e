# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Vents: position, discharge and temperature of erupting lava."""

from bisect import bisect
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
import math

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.scene.lava import Lava
from lava_ros.scene.terrain import Terrain
from lava_ros.scene.typed_places import likely_place
from lava_ros.scene.vent_keys import Discharge, VENT_KEYS


@dataclass(frozen=True)
class Vent:
    """A source of lava: a disc, or a fissure if ``end`` is given.

    Attributes:
        position: Centre of the disc, or one end of the fissure, (x, y) [m] in the map frame.
        discharge: Volume flux [m3/s]: a constant, or a series of (time [s], flux [m3/s]) pairs of
            increasing time. Each flux holds from its time until the next; before the first, 0.
        temperature: Temperature of the erupting lava [K]; None: a scene sets it to
            ``Lava.reference_temperature``.
        radius: Radius of the disc, or half the width of the fissure [m].
        end: Other end of the fissure, (x, y) [m], None for a disc.
        name: Free text that identifies the vent in logs and messages.
        velocity: Horizontal velocity (vx, vy) of the erupting lava [m/s]; has no effect without
            inertia (``Effects.inertia``).
    """

    position: tuple[float, float]
    discharge: Discharge
    # None until the vent is in a scene
    temperature: float = None  # type: ignore[assignment]
    radius: float = 10.0
    end: tuple[float, float] | None = None
    name: str = ''
    velocity: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Validate and normalise all fields; raise LavaError for an invalid one."""
        validation.text('vent.name', self.name)
        label = f'vent {self.name!r}' if self.name else 'vent'
        given = {
            name: value for name, value in vars(self).items()
            if value is not None or name not in ('end', 'temperature')
        }
        for name, value in VENT_KEYS.values(label, given).items():
            object.__setattr__(self, name, value)

    @property
    def series(self) -> tuple[tuple[float, float], ...]:
        """Discharge as (time [s], flux [m3/s]) pairs; a constant starts at minus infinity."""
        if isinstance(self.discharge, float):
            return ((-math.inf, self.discharge),)
        return tuple(self.discharge)

    @property
    def peak(self) -> float:
        """Maximum discharge [m3/s]."""
        return max(flux for _, flux in self.series)

    def discharge_at(self, time: float) -> float:
        """Return the discharge [m3/s] at a simulated time [s]."""
        series = self.series
        index = bisect(series, (time, math.inf)) - 1
        return series[index][1] if index >= 0 else 0.0

    def next_opening(self, since: float) -> float:
        """Return the first time [s] with lava at or after ``since`` [s], infinite without any."""
        ends = [*(time for time, _ in self.series[1:]), math.inf]
        for (time, flux), end in zip(self.series, ends, strict=True):
            if flux > 0.0 and end > since:
                return max(time, since)
        return math.inf

    def volume_between(self, start: float, end: float) -> float:
        """Return the exact volume [m3] that the vent emits from ``start`` to ``end`` [s]."""
        return self.volumes_at([end], since=start)[0]

    def volumes_at(self, times: Sequence[float], *, since: float) -> list[float]:
        """Return the volumes [m3] emitted from ``since`` to each of some increasing times [s]."""
        series = self.series
        volumes, before, index = [], 0.0, 0
        for end in times:
            while index + 1 < len(series) and series[index + 1][0] <= end:
                (time, flux), until = series[index], series[index + 1][0]
                before += flux * max(0.0, until - max(since, time))
                index += 1
            time, flux = series[index]
            volumes.append(before + flux * max(0.0, end - max(since, time)))
        return volumes


def check_vents(
    vents: Iterable[Vent], terrain: Terrain, lava: Lava | None = None
) -> tuple[Vent, ...]:
    """Return the vents as a tuple; the ``lava`` sets the temperature of vents without one.

    Raises:
        LavaError: If the position or end of a vent is off the ground: without data or in the sea.
    """
    if not isinstance(vents, Iterable):
        raise LavaError('vents', vents, 'vents, or an empty list')
    result = tuple(vents)
    for index, vent in enumerate(result):
        if not isinstance(vent, Vent):
            raise LavaError(f'vents[{index}]', vent, 'a Vent')
        for name, key in (('position', 'projected'), ('end', 'projected_end')):
            point = getattr(vent, name)
            if point is None or terrain.covers(*point):
                continue
            expected = f'a place {terrain.bounds()}'
            if terrain.covers(*terrain.to_map(*point)):
                as_projected = f'as easting and northing (the key {key})'
                expected += f': {as_projected}, it would be on the terrain'
            raise LavaError(f'vents[{index}].{name}', point, expected)
    if lava is None:
        return result
    return tuple(
        replace(vent, temperature=lava.reference_temperature) if vent.temperature is None else vent
        for vent in result
    )


def erupting(vents: Sequence[Vent], *, duration: float, volume: float) -> tuple[Vent, ...]:
    """Stretch the discharges of vents to a duration [s] and scale them to a total volume [m3].

    The longest series and all constant discharges end after ``duration``. Volumes before time 0 do
    not count.

    Raises:
        LavaError: If a series does not end with 0 after time 0, or the vents emit no lava.
    """
    ends = []
    for index, vent in enumerate(vents):
        time, flux = vent.series[-1]
        if math.isfinite(time) and (flux > 0.0 or time <= 0.0):
            expected = 'a constant, or a series that ends with 0 after time 0, to be stretched'
            raise LavaError(f'vents[{index}].discharge', vent.series[-1], expected)
        ends += [time] if math.isfinite(time) else []
    span = max(ends, default=1.0)
    whole = sum(vent.volume_between(0.0, span) for vent in vents)
    if whole == 0.0:
        raise LavaError('vents.discharge', 0.0, 'a discharge above 0')
    longer = duration / span
    more = volume / (whole * longer)
    result = []
    for vent in vents:
        # a constant ends after the span
        later = [item for item in vent.series if item[0] > 0.0] or [(span, 0.0)]
        series = [(0.0, vent.discharge_at(0.0)), *later]
        result.append(replace(vent, discharge=[(at * longer, q * more) for at, q in series]))
    return tuple(result)


def vents_from_list(items: object, terrain: Terrain) -> tuple[Vent, ...]:
    """Build vents from the plain data of a YAML file.

    Args:
        items: List of mappings with the fields of ``Vent``; ``projected: [easting, northing]`` may
            replace ``position``, ``projected_end`` may replace ``end``, and ``effusion_rate`` may
            replace ``discharge``.
        terrain: Terrain on which the vents have to be.

    Raises:
        LavaError: If the data are not such a list.
    """
    vents: list[Vent] = []
    for where, item in validation.items('vents', items, 'a list of vents'):
        data = VENT_KEYS(where, item)
        if ('effusion_rate' in data) == ('discharge' in data):
            if 'discharge' in data:
                raise validation.conflict(f'{where}.effusion_rate', 'discharge')
            expected = 'a value: this key is required'
            raise LavaError(f'{where}.effusion_rate', None, expected)
        if 'effusion_rate' in data:
            data['discharge'] = data.pop('effusion_rate')
        for source, target in (('projected', 'position'), ('projected_end', 'end')):
            if source in data:
                if target in data:
                    raise validation.conflict(f'{where}.{source}', target)
                place = data.pop(source)
                data[target] = terrain.to_map(*place)
                if not terrain.covers(*terrain.to_map(*place)):
                    expected = f'a place {terrain.bounds(projected=True)}'
                    expected += likely_place(terrain, *place)
                    raise LavaError(f'{where}.{source}', place, expected)
        if 'position' not in data:
            raise LavaError(f'{where}.position', None, 'a value: this key is required')
        data.setdefault('name', f'vent {len(vents)}')
        vents.append(Vent(**data))
    return check_vents(vents, terrain)


#: Maximum number of closed vents in a schedule, and of entries of a vent's series.
MAX_CLOSED, MAX_SERIES = 100, 1000


def distances(vents: Sequence[Vent], others: Sequence[Vent]) -> Iterator[np.ndarray]:
    """Yield, for each vent, its distances from other vents [m], shape [others].

    The distance between two fissures is the larger of the distances between their ends, in the
    better order of the ends. A disc and a fissure are infinitely far apart.
    """

    def ends(some: Sequence[Vent]) -> np.ndarray:
        places = [(*vent.position, *(vent.end or vent.position)) for vent in some]
        return np.array(places, dtype=np.float64).reshape(-1, 2).view(np.complex128).reshape(-1, 2)

    rows, is_fissure = ends(others), np.array([other.end is not None for other in others], bool)
    for vent, row in zip(vents, ends(vents), strict=True):
        ahead = np.abs(rows - row).max(axis=1)
        reversed_ = np.abs(rows - row[::-1]).max(axis=1)
        is_alike = is_fissure == (vent.end is not None)
        yield np.where(is_alike, np.minimum(ahead, reversed_), np.inf)


def extents(vents: Sequence[Vent], least: float = 0.0) -> np.ndarray:
    """Return the size of each vent [m]: its radius or half of its length, at least ``least``."""
    lengths = [math.dist(vent.position, vent.end or vent.position) for vent in vents]
    radii = [vent.radius for vent in vents]
    return np.maximum(np.maximum(radii, np.multiply(0.5, lengths)), least)


def match_vents(
    before: Sequence[Vent], after: Sequence[Vent], *, least: float = 0.0, by_name: bool = True
) -> list[int | None]:
    """Match vents after a change with the same vents before it.

    A vent matches the earlier vent at the same place. Otherwise it matches the nearest one within
    the size of either vent, preferably with the same name or temperature. Otherwise, with
    ``by_name``, it matches the earlier vent with its name.

    Args:
        before: Vents before the change.
        after: Vents after the change.
        least: Minimum size of a vent [m].
        by_name: True to match a vent that has moved farther than its size by its name.

    Returns:
        For each vent of ``after`` the index of its match in ``before``, None for a new vent. No
        index occurs twice.
    """
    result: list[int | None] = [None] * len(after)
    free = set(range(len(before)))
    keys: list[Callable[[Vent], object]] = [
        lambda vent: (vent.position, vent.end, vent.name, vent.temperature),
        lambda vent: (vent.position, vent.end, vent.name),
        lambda vent: (vent.position, vent.end),
    ]

    def take(pairs: Iterable[tuple[int, int]]) -> None:
        for new, old in pairs:
            if result[new] is None and old in free:
                result[new] = old
                free.remove(old)

    def take_equal(key: Callable[[Vent], object]) -> None:
        olds = defaultdict(list)
        for old in sorted(free):
            olds[key(before[old])].append(old)
        news = [new for new, old in enumerate(result) if old is None]
        take((new, old) for new in news for old in olds.get(key(after[new]), ()))

    for key in keys:
        take_equal(key)
    rest = sorted(free)
    candidates = [before[old] for old in rest]
    news = [new for new, old in enumerate(result) if old is None] if rest else []
    moved = [after[new] for new in news]
    sizes, near = extents(candidates, least), []
    for new, vent, size, apart in zip(
        news, moved, extents(moved, least), distances(moved, candidates), strict=True
    ):
        nearest = np.argsort(apart, kind='stable')[:16]
        for place in nearest[apart[nearest] <= np.maximum(sizes[nearest], size)]:
            old = candidates[place]
            is_other = not vent.name or vent.name != old.name
            is_changed = vent.temperature != old.temperature
            near.append((is_other, is_changed, apart[place], new, rest[place]))
    take((new, old) for *_, new, old in sorted(near))
    if by_name:
        # vents without a name do not match, and a disc never matches a fissure
        unnamed = count()
        take_equal(lambda vent: (vent.name or next(unnamed), vent.end is None))
    return result


def schedule(before: Sequence[Vent], vents: Sequence[Vent], time: float) -> tuple[Vent, ...]:
    """Combine the discharges of vents before and after a change at ``time``, simulated [s].

    Each vent emits as in ``before`` up to that time, and as in ``vents`` after it; one that is
    missing in ``vents`` closes. A vent that has moved within its own size, or changed within
    sensor noise, remains the same vent, with its newest place and temperature.
    """
    matches = match_vents(before, vents, by_name=False)
    continued = {
        old: new
        for new, old in enumerate(matches)
        if old is not None and _is_alike(before[old], vents[new])
    }
    closed, open_ = [], []
    for index, vent in enumerate(before):
        after = vents[continued[index]] if index in continued else None
        start = [(0.0, vent.discharge_at(0.0))] if time > 0.0 else []
        past = [*start, *(entry for entry in vent.series if 0.0 < entry[0] < time)]
        if after is not None:
            open_.append(_join_series(after, past, after, time))
        elif any(flux > 0.0 for _, flux in past):
            closed.append(_join_series(vent, past, None, time))
    known = set(continued.values())
    new = [_join_series(vent, [], vent, time) for at, vent in enumerate(vents) if at not in known]
    return (*closed[-MAX_CLOSED:], *open_, *new)


def are_alike(vents: Sequence[Vent], others: Sequence[Vent]) -> bool:
    """Return True if vents differ from other vents only by sensor noise.

    Each vent then lies within the radius of its match, and discharges differ by at most 5 %.
    """
    matches = _matches_in_place(vents, others)
    return matches is not None and all(
        _is_alike(other, vent) and _has_discharge_of(vent, other)
        for vent, other in zip(vents, matches, strict=True)
    )


def are_in_place(vents: Sequence[Vent], others: Sequence[Vent]) -> bool:
    """Return True if each vent lies within the radius of its match, with none left over."""
    return _matches_in_place(vents, others) is not None


def _matches_in_place(vents: Sequence[Vent], others: Sequence[Vent]) -> list[Vent] | None:
    """Return the matching vent for each vent, None if a vent has no match nearby."""
    if len(vents) != len(others):
        return None
    matches = match_vents(others, vents)
    found = [others[match] for match in matches if match is not None]
    is_complete = len(found) == len(vents) and all(
        next(distances([vent], [other]))[0] <= extents([other])[0]
        for vent, other in zip(vents, found, strict=True)
    )
    return found if is_complete else None


def _is_alike(one: Vent, other: Vent) -> bool:
    """Return True if two vents differ only by noise in temperature and radius."""
    temperatures = [vent.temperature for vent in (one, other) if vent.temperature is not None]
    return (
        max(temperatures, default=0.0) - min(temperatures, default=0.0) <= 10.0
        and math.isclose(one.radius, other.radius, rel_tol=0.1)
        and one.velocity == other.velocity
    )


def _has_discharge_of(one: Vent, other: Vent) -> bool:
    if len(one.series) != len(other.series):
        return False
    (times, fluxes), (other_times, other_fluxes) = np.swapaxes([one.series, other.series], 1, 2)
    return np.array_equal(times, other_times) and np.allclose(
        fluxes, other_fluxes, rtol=0.05, atol=0.0
    )


def _join_series(
    vent: Vent, past: Sequence[tuple[float, float]], after: Vent | None, time: float
) -> Vent:
    """Return a vent that emits its past series, and after ``time`` that of ``after`` or 0."""
    now = (time, after.discharge_at(time) if after is not None else 0.0)
    rest = [entry for entry in after.series if entry[0] > time] if after is not None else []
    changes: list[tuple[float, float]] = []
    for at, flux in (*past, now, *rest):
        if flux != (changes[-1][1] if changes else 0.0):
            changes.append((at, flux))
    if not changes or (changes[0] == (0.0, now[1]) and len(changes) == 1):
        # the discharge has never changed
        return replace(vent, discharge=now[1])
    return replace(vent, discharge=tuple(_shorten_series(changes)))


def _shorten_series(series: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Shorten a series to at most ``MAX_SERIES`` entries with the same volume.

    The older half is merged in pairs, each with the mean discharge.
    """
    while len(series) > MAX_SERIES:
        older, joined = len(series) // 4 * 2, []
        for index in range(0, older, 2):
            (start, first), (middle, second) = series[index : index + 2]
            end = series[index + 2][0]
            volume = first * (middle - start) + second * (end - middle)
            joined.append((start, volume / (end - start)))
        series = joined + series[older:]
    return series
