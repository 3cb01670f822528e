# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The time at which an eruption began, and simulated times as dates: UTC and local."""

from dataclasses import dataclass
from datetime import datetime, timedelta, timezone, tzinfo
from zoneinfo import ZoneInfo

from lava_ros.errors import LavaError


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
    def from_texts(cls, onset: str, zone: str | None = None) -> 'Onset':
        """Read a date and time in ISO 8601, and the name of a time zone.

        Raises:
            LavaError: If the date has no offset from UTC, or one of the texts cannot be read.
        """
        right = 'a date and time with its offset from UTC, such as 2006-07-14T22:00Z'
        try:
            start = datetime.fromisoformat(onset.strip().replace('Z', '+00:00'))
            is_usable = start.tzinfo is not None and start.year > 1
        except ValueError:
            is_usable = False
        if not is_usable:
            raise LavaError('--onset', onset, right)
        if zone is None:
            return cls(start)
        try:
            return cls(start, ZoneInfo(zone))
        except (KeyError, ValueError, OSError) as error:
            right = 'a time zone that this machine knows, such as Europe/Rome (package tzdata)'
            raise LavaError('--timezone', zone, right) from error

    def words(self, seconds: float = 0.0) -> str:
        """Format a simulated time [s] as date and time, in UTC and in local time.

        Raises:
            LavaError: If the time is beyond the years that a date can have.
        """
        try:
            utc = (self.start + timedelta(seconds=seconds)).astimezone(timezone.utc)
            local = utc.astimezone(self.zone)
        except OverflowError as error:
            right = f'a date, {seconds:g} s after which the year is at most 9999'
            raise LavaError('--onset', self.start.isoformat(), right) from error
        text = f'{utc:%Y-%m-%d %H:%M} UTC'
        if local.utcoffset() == timedelta(0):
            return text
        day = '' if local.date() == utc.date() else f'{local:%Y-%m-%d} '
        return f'{text} ({day}{local:%H:%M %Z})'
