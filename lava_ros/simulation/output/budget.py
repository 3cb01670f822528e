# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Volume budget of a simulation, as text for diagnostics and for people."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

from lava_ros.simulation.particles.layout import BORDER, HOLES, SEA

#: Maximum fraction of the emitted volume that may be unaccounted for: guaranteed accuracy.
VOLUME_TOLERANCE = 1e-5

#: Fraction of the emitted volume above which lava that has left the map causes a warning.
GONE = 1e-3

#: Fraction of the emitted volume above which lava too thin to inundate causes a warning, and
#: above which lava that waits in the vents at the end of a run does.
THIN = WAITING = 0.1

#: Volumes by the names in their keys (``volume_key``): label for people, and meaning. The emitted
#: volume is the sum of the others without ``overdue`` and ``thin``, which are parts of others.
VOLUMES = {
    'emitted': ('emitted', 'from the vents, and present at the start'),
    'flowing': ('flowing', 'on the map, and not solidified'),
    'solidified': ('solidified', 'part of the ground'),
    'lost_over_border': ('lost over the border', 'on no map'),
    'lost_in_no_data': ('lost in no-data cells', 'on no map'),
    'lost_in_sea': ('lost in the sea', 'on no map'),
    'waiting': ('waiting in the vents', 'less than one particle per vent, and the overdue volume'),
    'overdue': ('overdue in the vents', 'part of waiting: a vent is behind its effusion rate'),
    'thin': ('too thin to inundate', 'part of the lava on the map'),
}

#: Label of the volume that only scenes with a sea show.
LABEL_OF_SEA, _ = VOLUMES['lost_in_sea']

#: Parts that are on no map, although no scene intends it.
_GONE = ('lost_over_border', 'lost_in_no_data')


def volume_key(name: str) -> str:
    """Return the key of a volume of ``VOLUMES`` in diagnostics, ``run.json`` and bags."""
    return f'volume_{name}_m3'


@dataclass(frozen=True)
class VolumeBudget:
    """The ``VOLUMES`` of lava [m3]: emitted = flowing + solidified + lost + waiting.

    The emitted volume is the exact integral of the discharge, and the volume at the start. A
    budget without maps has no ``thin`` volume.
    """

    emitted: float
    flowing: float
    solidified: float = 0.0
    lost_over_border: float = 0.0
    lost_in_no_data: float = 0.0
    lost_in_sea: float = 0.0
    waiting: float = 0.0
    overdue: float = 0.0
    thin: float = 0.0

    @property
    def lost(self) -> float:
        """Volume that has flowed over the border, onto cells without data or into the sea [m3]."""
        return self.lost_over_border + self.lost_in_no_data + self.lost_in_sea

    @property
    def error(self) -> float:
        """Fraction of the emitted volume that is unaccounted for."""
        found = self.flowing + self.solidified + self.lost + self.waiting
        missing = abs(self.emitted - found)
        return missing / self.emitted if self.emitted > 0.0 else missing

    def texts(self) -> dict[str, str]:
        """Return the values of a diagnostics status, by key."""
        volumes = {volume_key(name): repr(getattr(self, name)) for name in VOLUMES}
        return {**volumes, 'volume_error': f'{self.error:.3e}'}

    @classmethod
    def from_texts(cls, values: Mapping[str, str]) -> 'VolumeBudget | None':
        """Parse the values that ``texts`` returns; None if one is missing or is not a number."""
        try:
            return cls(**{name: float(values[volume_key(name)]) for name in VOLUMES})
        except (KeyError, ValueError):
            return None

    def parts(self) -> dict[str, float]:
        """Return the volumes [m3] of the rows by their labels for people."""
        return {
            label: getattr(self, name) for name, (label, _) in VOLUMES.items() if name != 'thin'
        }

    def rows(self) -> list[tuple[str, str]]:
        """Return labels and values for people, ending with the volume error."""
        rows = [
            (label, f'{_shown(volume)} m3') for label, volume in self.parts().items()
            # scenes usually have no sea
            if label != LABEL_OF_SEA or volume > 0.0
        ]
        error = 'below 1e-15' if self.error < 1e-15 else f'{self.error:.1e}'
        return [*rows, ('error', f'{error} of the emitted volume')]

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
        if self.overdue > 0.0:
            texts.append(f'behind: {self.overdue:.3g} m3 of lava is overdue in the vents')
        thin = 'is on ground that it has not inundated: it is too thin to count'
        for part, max_fraction, fate in (
            *((part, GONE, f'was {VOLUMES[part][0]}: it is on no map') for part in _GONE),
            ('thin', THIN, thin),
        ):
            gone = getattr(self, part)
            if gone > max_fraction * self.emitted:
                percent = 100.0 * gone / self.emitted if self.emitted > 0.0 else math.nan
                texts.append(f'{percent:.3g} % of the lava {fate}')
        return texts

    def warnings_at_end(self) -> list[str]:
        """Return ``warnings`` of a run that has ended: no more lava comes out."""
        texts = self.warnings()
        if self.emitted == 0.0:
            texts.append('there is no lava: no vent has emitted any by the end')
        if self.waiting > WAITING * self.emitted:
            percent = 100.0 * self.waiting / self.emitted
            texts.append(
                f'{percent:.3g} % of the lava waits in the vents and is on no map: '
                'a smaller spacing needs less of it for a particle'
            )
        return texts


def lost_volumes(left: Sequence[float]) -> dict[str, float]:
    """Return the lost volumes of a budget, by ``State.left`` [m3]."""
    return {
        'lost_over_border': float(left[BORDER]), 'lost_in_no_data': float(left[HOLES]),
        'lost_in_sea': float(left[SEA]),
    }


def _shown(volume: float) -> str:
    # four digits for a laboratory flow, 0.1 m3 for an eruption
    return f'{volume:,.1f}' if abs(volume) >= 1000.0 else f'{volume:.4g}'
