# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Volume budget of a simulation, as text for diagnostics and for people."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
import math

#: Maximum fraction of the emitted volume that may be unaccounted for: guaranteed accuracy.
VOLUME_TOLERANCE = 1e-5

#: Fraction of the emitted volume above which lava that has left the map causes a warning.
GONE = 1e-3

#: Fraction of the emitted volume above which lava too thin to inundate causes a warning, and
#: above which lava that waits in the vents at the end of a run does.
THIN = WAITING = 0.1

#: Labels of the parts of a budget, in the order of their rows.
_PARTS = {
    'emitted': 'emitted',
    'flowing': 'flowing',
    'frozen': 'solidified',
    'over_border': 'lost over the border',
    'in_holes': 'lost in no-data cells',
    'in_sea': 'in the sea',
    'pending': 'waiting in the vents',
    'late': 'overdue in the vents',
}

#: Parts that are on no map.
_GONE = ('over_border', 'in_holes')


@dataclass(frozen=True)
class VolumeBudget:
    """Volumes of lava [m3]: emitted = held + left + frozen.

    Attributes:
        emitted: Volume from the vents, the exact integral of their discharge, and the volume at
            the start of the simulation.
        held: Volume in the simulation: the sum of the particles' volumes, and ``pending``.
        pending: Part of ``held`` that waits in the vents' conduits, less than one particle per
            vent (less than eight where vents emit symmetrically).
        left: Volume that has flowed over the terrain's border, onto cells without data or into the
            sea.
        frozen: Volume that has solidified and become ground.
        late: Part of ``pending`` that is overdue: the vents are behind.
        in_holes: Part of ``left`` that has flowed onto cells without data.
        in_sea: Part of ``left`` that has flowed into the sea.
        thin: Volume on cells that lava has not reached, because it is too thin to count
            (``Accuracy.inundation_threshold``); 0 in a budget without maps.
    """

    emitted: float
    held: float
    pending: float
    left: float
    frozen: float = 0.0
    late: float = 0.0
    in_holes: float = 0.0
    in_sea: float = 0.0
    thin: float = 0.0

    @property
    def error(self) -> float:
        """Fraction of the emitted volume that is unaccounted for."""
        missing = abs(self.emitted - self.held - self.left - self.frozen)
        return missing / self.emitted if self.emitted > 0.0 else missing

    @property
    def flowing(self) -> float:
        """Part of ``held`` that is on the map [m3]."""
        return self.held - self.pending

    @property
    def over_border(self) -> float:
        """Part of ``left`` that has flowed over the border [m3]."""
        return self.left - self.in_holes - self.in_sea

    def texts(self) -> dict[str, str]:
        """Return the values of a diagnostics status, by key."""
        volumes = {_key(item.name): repr(getattr(self, item.name)) for item in fields(self)}
        return {**volumes, 'volume_error': f'{self.error:.3e}'}

    @classmethod
    def from_texts(cls, values: Mapping[str, str]) -> 'VolumeBudget | None':
        """Parse the values that ``texts`` returns; None if emitted, held or left is missing.

        Volumes that older recordings lack count as 0.
        """
        known = {}
        for item in fields(cls):
            try:
                known[item.name] = float(values[_key(item.name)])
            except (KeyError, ValueError):
                continue
        needed = {'emitted', 'held', 'left'} <= set(known)
        return cls(**{'pending': 0.0, **known}) if needed else None

    def parts(self) -> dict[str, float]:
        """Return the volumes [m3] by their labels for people."""
        return {label: getattr(self, part) for part, label in _PARTS.items()}

    def rows(self) -> list[tuple[str, str]]:
        """Return labels and values for people, ending with the unaccounted volume."""
        rows = [
            (label, f'{_shown(volume)} m3') for label, volume in self.parts().items()
            # scenes usually have no sea
            if label != _PARTS['in_sea'] or volume > 0.0
        ]
        error = 'below 1e-15' if self.error < 1e-15 else f'{self.error:.1e} of the emitted volume'
        return [*rows, ('unaccounted for', error)]

    def text(self) -> str:
        """Return all rows on one line."""
        return ', '.join(f'{name} {value}' for name, value in self.rows())

    @property
    def is_conserved(self) -> bool:
        """True if the whole volume is accounted for."""
        # False if the error is NaN
        return self.error <= VOLUME_TOLERANCE

    def warnings(self) -> list[str]:
        """Return warnings for a reader of the maps, as phrases."""
        texts = []
        if not self.is_conserved:
            texts.append(f'volume is not conserved: {self.error:.1e} of it is unaccounted for')
        if self.late > 0.0:
            texts.append(f'behind: {self.late:.3g} m3 of lava wait in the vents')
        thin = 'is on ground that it has not inundated: it is too thin to count'
        for part, most, fate in (
            *((part, GONE, f'was {_PARTS[part]}: it is on no map') for part in _GONE),
            ('thin', THIN, thin),
        ):
            gone = getattr(self, part)
            if gone > most * self.emitted:
                percent = 100.0 * gone / self.emitted if self.emitted > 0.0 else math.nan
                texts.append(f'{percent:.3g} % of the lava {fate}')
        return texts

    def warnings_at_end(self) -> list[str]:
        """Return ``warnings`` of a run that has ended: no more lava comes out."""
        texts = self.warnings()
        if self.emitted == 0.0:
            texts.append('there is no lava: no vent has emitted any by the end')
        if self.pending > WAITING * self.emitted:
            percent = 100.0 * self.pending / self.emitted
            texts.append(
                f'{percent:.3g} % of the lava waits in the vents and is on no map: '
                'a smaller spacing needs less of it for a particle'
            )
        return texts


def _shown(volume: float) -> str:
    # four digits for a laboratory flow, 0.1 m3 for an eruption
    return f'{volume:,.1f}' if abs(volume) >= 1000.0 else f'{volume:.4g}'


def _key(name: str) -> str:
    return f'volume_{name}_m3'
