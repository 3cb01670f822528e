# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The time at which an eruption began, and simulated times as dates: UTC and local."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone, tzinfo
import logging
from zoneinfo import ZoneInfo

from lava_ros import validation
from lava_ros.errors import LavaError, refusing
from lava_ros.scene.scene import date_text, Scene

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Onset:
    """The date and time of simulated time 0.

    Attributes:
        start: The date and time, with its offset from UTC.
        zone: Zone of local times; None for that of this machine.
    """

    start: datetime
    zone: tzinfo | None = None

    @classmethod
    def from_text(cls, onset: str, *, field: str = '--start') -> 'Onset':
        """Read a date and time in ISO 8601 (``validation.date``); errors name ``field``.

        Raises:
            LavaError: If the text cannot be read.
        """
        return cls(validation.date(field, onset))

    @property
    def text(self) -> str:
        """The date and time in ISO 8601, as ``from_text`` reads it and bags record it."""
        return date_text(self.start)

    @classmethod
    def of(cls, scene: Scene) -> 'Onset | None':
        """Return the onset of a scene; None if it is unknown."""
        return None if scene.onset is None else cls(scene.onset)

    def utc(self, seconds: float = 0.0) -> str:
        """Format a simulated time [s] as date and time in ISO 8601, UTC, to the second.

        Raises:
            LavaError: If the time is beyond the years that a date can have.
        """
        return f'{self._date(seconds).replace(tzinfo=None).isoformat(timespec="seconds")}Z'

    def words(self, seconds: float = 0.0) -> str:
        """Format a simulated time [s] as date and time, in UTC and in local time.

        Raises:
            LavaError: If the time is beyond the years that a date can have.
        """
        utc = self._date(seconds)
        local = utc.astimezone(self.zone)
        text = f'{utc:%Y-%m-%d %H:%M} UTC'
        if local.utcoffset() == timedelta(0):
            return text
        day = '' if local.date() == utc.date() else f'{local:%Y-%m-%d} '
        return f'{text} ({day}{local:%H:%M %Z})'

    def _date(self, seconds: float) -> datetime:
        expected = f'a date, {seconds:g} s after which the year is at most 9999'
        with refusing('onset', self.text, expected, OverflowError):
            return (self.start + timedelta(seconds=seconds)).astimezone(timezone.utc)


def time_zone(name: str) -> ZoneInfo:
    """Return a time zone by its name.

    Raises:
        LavaError: If it is not available on this machine.
    """
    expected = 'a time zone of this machine, such as Europe/Rome; tzdata adds all zones'
    with refusing('--timezone', name, expected, KeyError, ValueError, OSError):
        return ZoneInfo(name)


def recorded_onset(custom_data: Mapping[str, str]) -> Onset | None:
    """Return the onset that the description of a bag states, as ``stated_onset`` reads it."""
    return stated_onset(custom_data.get('onset', 'unknown'), 'the bag')


def stated_onset(text: str, where: str) -> Onset | None:
    """Return the onset of a text; None if it is ``unknown``.

    A text that cannot be read is logged, with ``where`` it is from, and ignored.
    """
    if text == 'unknown':
        return None
    try:
        return Onset.from_text(text, field=f'onset of {where}')
    except LavaError as error:
        _LOG.warning(f'{error}: dates are left out')
        return None
