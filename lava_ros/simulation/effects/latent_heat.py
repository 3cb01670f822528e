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


"""Latent heat: crystals that form between liquidus and solidus give heat.

Crystallisation is linear in temperature, so the heat content over rho c h is
T + (L / c) F with the melt fraction F = (T - solidus) / (liquidus - solidus) between 0 and 1, and
within the interval temperature changes 1 + L / (c (liquidus - solidus)) times more slowly. A step
is solved piece by piece: up to the end of the interval, across it, and on from there. So the heat
content changes by exactly what was lost, for any step.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation.heat import heat_constants_of, relaxation_function


@lru_cache
def relaxed(real: Any) -> Any:
    """Return the device function that gives the temperature after a step at constant s and f."""
    relaxation = relaxation_function(real)

    @wp.func
    def relaxed(
        constants: heat_constants_of(real), temperature: real, rate: real, source: real, step: real
    ) -> real:
        solidus = real(constants.solidus)
        liquidus = real(constants.liquidus)
        slower = real(1.0) + real(constants.latent) / (liquidus - solidus)
        falls = source < rate * temperature
        result = temperature
        remaining = step
        for _ in range(3):
            if remaining > real(0.0):
                end = real(0.0)
                factor = real(1.0)
                if falls:
                    if result > liquidus:
                        end = liquidus
                    elif result > solidus:
                        end = solidus
                        factor = slower
                else:
                    end = real(1.0e9)
                    if result < solidus:
                        end = solidus
                    elif result < liquidus:
                        end = liquidus
                        factor = slower
                reached = relaxation(result, rate / factor, source / factor, remaining)
                passed = reached > end
                if falls:
                    passed = reached < end
                if passed:
                    # of the time, the part it takes to the end of the piece
                    share = (result - end) / (result - reached)
                    x = rate * remaining / factor
                    if x > real(1.0e-6):
                        equilibrium = source / rate
                        share = wp.log((result - equilibrium) / (end - equilibrium)) / x
                    remaining *= wp.clamp(real(1.0) - share, real(0.0), real(1.0))
                    result = end
                else:
                    result = reached
                    remaining = real(0.0)
        return result

    return relaxed


@lru_cache
def warmed(real: Any) -> Any:
    """Return the device function that gives the temperature after heat worth a rise is added."""

    @wp.func
    def warmed(constants: heat_constants_of(real), temperature: real, rise: real) -> real:
        solidus = real(constants.solidus)
        latent = real(constants.latent)
        width = real(constants.liquidus) - solidus
        melt = wp.clamp((temperature - solidus) / width, real(0.0), real(1.0))
        # heat content above the solidus
        heat = temperature - solidus + latent * melt + rise
        if heat <= real(0.0):
            return solidus + heat
        if heat >= width + latent:
            return solidus + heat - latent
        return solidus + heat * width / (width + latent)

    return warmed
