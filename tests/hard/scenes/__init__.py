# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The hard scenes by family."""

from hard.case import HardScene
from hard.scenes import lava, terrain

FAMILIES: dict[str, tuple[HardScene, ...]] = {
    'viscosity': lava.VISCOSITY, 'thickness': lava.THICKNESS, 'terrain': terrain.SCENES,
    'vents': lava.VENTS, 'particles': lava.PARTICLES, 'heat': lava.HEAT, 'long': terrain.LONG,
}

SCENES: dict[str, HardScene] = {item.name: item for family in FAMILIES.values() for item in family}
