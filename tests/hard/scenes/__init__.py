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

"""The hard scenes by family."""

from hard.case import HardScene
from hard.scenes import lava, terrain

FAMILIES: dict[str, tuple[HardScene, ...]] = {
    'viscosity': lava.VISCOSITY, 'thickness': lava.THICKNESS, 'terrain': terrain.SCENES,
    'vents': lava.VENTS, 'particles': lava.PARTICLES, 'heat': lava.HEAT, 'long': terrain.LONG,
}

SCENES: dict[str, HardScene] = {
    item.name: item for family in FAMILIES.values() for item in family
}
