# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Where the lava is: the one account of its volume, to diagnostics and back, and for people."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
import math

#: Share of the emitted volume that may be unaccounted for: the promise of the simulation.
VOLUME_TOLERANCE = 1e-5

#: Share of the emitted volume from which on it is said that it is gone from the map.
GONE = 1e-3

#: What each part of a budget is called, in the order that it is told in.
_PARTS = {
    'emitted': 'emitted',
    'flowing': 'flowing',
    'frozen': 'frozen',
    'over_border': 'left over the border',
    'in_holes': 'left into cells without data',
    'pending': 'waiting in the vents',
    'late': 'of that late',
}


@dataclass(frozen=True)
class VolumeBudget:
    """Where the lava is [m3]: what came in equals what is held and what has left.

    Attributes:
        emitted: What the vents have given, the exact integral of their discharge, and what the
            simulation was started with.
        held: What the simulation holds: the sum of the particles' volumes, and ``pending``.
        pending: The part of ``held`` that waits in the vents' conduits, less than a particle each
            (less than eight where they emit symmetrically).
        left: What has flowed over the terrain's border or onto cells without data.
        frozen: What has solidified and become ground.
        late: The part of ``pending`` that should have come out: the vents are behind.
        in_holes: The part of ``left`` that has come onto cells without data.
    """

    emitted: float
    held: float
    pending: float
    left: float
    frozen: float = 0.0
    late: float = 0.0
    in_holes: float = 0.0

    @property
    def error(self) -> float:
        """Share of the emitted volume that is unaccounted for."""
        missing = abs(self.emitted - self.held - self.left - self.frozen)
        return missing / self.emitted if self.emitted > 0.0 else missing

    @property
    def flowing(self) -> float:
        """The part of ``held`` that is on the map [m3]."""
        return self.held - self.pending

    @property
    def over_border(self) -> float:
        """The part of ``left`` that has flowed over the border [m3]."""
        return self.left - self.in_holes

    def texts(self) -> dict[str, str]:
        """The values of a status in diagnostics, by their names there."""
        volumes = {_key(item.name): repr(getattr(self, item.name)) for item in fields(self)}
        return {**volumes, 'volume_error': f'{self.error:.3e}'}

    @classmethod
    def from_texts(cls, values: Mapping[str, str]) -> 'VolumeBudget | None':
        """Read what ``texts`` has written; None where emitted, held or left is not there.

        What older recordings do not say counts as nothing.
        """
        known = {}
        for item in fields(cls):
            try:
                known[item.name] = float(values[_key(item.name)])
            except (KeyError, ValueError):
                continue
        needed = {'emitted', 'held', 'left'} <= set(known)
        return cls(**{'pending': 0.0, **known}) if needed else None

    def rows(self) -> list[tuple[str, str]]:
        """All of it for people: names and values, then what is unaccounted for."""
        told = [(name, f'{_shown(getattr(self, part))} m3') for part, name in _PARTS.items()]
        error = 'below 1e-15' if self.error < 1e-15 else f'{self.error:.1e} of what was emitted'
        return [*told, ('unaccounted for', error)]

    def text(self) -> str:
        """The rows in a line."""
        return ', '.join(f'{name} {value}' for name, value in self.rows())

    @property
    def is_conserved(self) -> bool:
        """Whether all of the volume is accounted for."""
        # what is no number is not
        return self.error <= VOLUME_TOLERANCE

    def warnings(self) -> list[str]:
        """What a reader of the maps has to know, as phrases."""
        said = []
        if not self.is_conserved:
            said.append(f'volume is not conserved: {self.error:.1e} of it is unaccounted for')
        if self.late > 0.0:
            said.append(f'behind: {self.late:.3g} m3 of lava wait in the vents')
        for part in ('over_border', 'in_holes'):
            gone = getattr(self, part)
            if gone > GONE * self.emitted:
                share = 100.0 * gone / self.emitted if self.emitted > 0.0 else math.nan
                said.append(f'{share:.3g} % of the lava has {_PARTS[part]}: it is on no map')
        return said


def _shown(volume: float) -> str:
    # of a flow on a table four digits, of an eruption its litres
    return f'{volume:,.1f}' if abs(volume) >= 1000.0 else f'{volume:.4g}'


def _key(name: str) -> str:
    return f'volume_{name}_m3'
