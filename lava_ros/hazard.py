# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""How dangerous lava is to what stands in a cell: thickness and temperature -> 0..100."""

import numpy as np

#: Thickness that buries or crushes what stands in its way [m].
LETHAL_THICKNESS = 0.5

#: Surface temperature up to which heat does no harm [K], 50 C: the limit of most machines.
SAFE_TEMPERATURE = 323.15

#: Temperature from which heat alone destroys people and machines [K], 300 C.
LETHAL_TEMPERATURE = 573.15


def hazard(
    thickness: np.ndarray,
    temperature: np.ndarray,
    *,
    lethal_thickness: float = LETHAL_THICKNESS,
    safe_temperature: float = SAFE_TEMPERATURE,
    lethal_temperature: float = LETHAL_TEMPERATURE,
) -> np.ndarray:
    """Combine burial and heat into one number per cell.

    Burial grows linearly from 0 to 1 at the lethal thickness, heat from 0 at the safe to 1 at the
    lethal temperature; the hazard is ``100 (1 - (1 - burial) (1 - heat))``, as if the two struck
    independently. It never decreases when the lava gets thicker or hotter.

    Args:
        thickness: Lava thickness [m], shape [rows, columns], NaN outside the terrain.
        temperature: Lava temperature [K], same shape, NaN where there is no lava. Lava of unknown
            temperature counts as lethally hot.
        lethal_thickness: Thickness at which burial alone is lethal [m].
        safe_temperature: Temperature up to which heat does no harm [K].
        lethal_temperature: Temperature from which heat alone is lethal [K].

    Returns:
        Hazard, float32, same shape: 0 without lava, 1 to 100 with lava, NaN outside the terrain.
    """
    thickness = np.asarray(thickness, dtype=np.float32)
    temperature = np.asarray(temperature, dtype=np.float32)
    wet = thickness > 0.0
    burial = np.clip(thickness / np.float32(lethal_thickness), 0.0, 1.0)
    span = np.float32(lethal_temperature - safe_temperature)
    heat = np.clip((temperature - np.float32(safe_temperature)) / span, 0.0, 1.0)
    heat = np.where(np.isnan(temperature), np.float32(1.0), heat)
    combined = 100.0 * (1.0 - (1.0 - burial) * (1.0 - heat))
    result = np.where(wet, np.maximum(combined, 1.0), 0.0)
    return np.where(np.isnan(thickness), np.nan, result).astype(np.float32)
