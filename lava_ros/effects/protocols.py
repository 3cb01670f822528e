# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Properties of a lava and of a scene that effects read (``lava_ros.scene``)."""

from typing import Any, Protocol


class Lava(Protocol):
    """Constants of a lava; those that effects declare are attributes too."""

    @property
    def density(self) -> float:
        """Density [kg/m3]."""

    @property
    def specific_heat(self) -> float:
        """Specific heat capacity [J/(kg K)]."""

    @property
    def radiates(self) -> bool:
        """True if it loses heat to the air."""

    def viscosity_at(self, temperature: float) -> float:
        """Return the viscosity [Pa s] at a temperature [K]."""

    def yield_strength_at(self, temperature: float) -> float:
        """Return the yield strength [Pa] at a temperature [K]."""

    def __getattr__(self, name: str) -> Any:
        """Return another constant."""


class Rheology(Protocol):
    """The laws of flow of a lava (``laws.Rheology``)."""

    @property
    def effects(self) -> Any:
        """Effects that are on."""

    def viscosity_at(self, temperature: float) -> float:
        """Return the viscosity [Pa s] at a temperature [K]."""

    def strength_at(self, temperature: float) -> float:
        """Return the yield strength [Pa] at a temperature [K]."""


class Scene(Protocol):
    """Surroundings of a lava; those that effects declare are attributes too."""

    @property
    def lava(self) -> Lava:
        """The material."""

    @property
    def ambient_temperature(self) -> float:
        """Temperature of the air [K]."""

    @property
    def gravity(self) -> float:
        """Acceleration of gravity [m/s2]."""

    def __getattr__(self, name: str) -> Any:
        """Return another property of the surroundings."""
