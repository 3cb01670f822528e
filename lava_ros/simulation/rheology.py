"""Viscosity of lava as a function of temperature."""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.scene import Lava


@wp.struct
class Rheology:
    """Constants of the viscosity law."""

    viscosity: wp.float64
    reference_temperature: wp.float64
    arrhenius: wp.float64


def rheology_of(lava: Lava) -> Rheology:
    """Collect the constants a viscosity function needs."""
    constants = Rheology()
    constants.viscosity = lava.viscosity
    constants.reference_temperature = lava.reference_temperature
    constants.arrhenius = lava.arrhenius
    return constants


@lru_cache
def viscosity_function(real: Any, arrhenius: bool) -> Any:
    """Return the device function mu(T) [Pa s]: constant, or the Arrhenius law of 3.26.

    The paper multiplies f(theta) = K_e exp(alpha (theta_e - theta)) by another constant mu of the
    same 100 Pa s; that counts the viscosity twice, so f alone is the viscosity here.
    """

    @wp.func
    def constant(law: Rheology, temperature: real) -> real:
        return real(law.viscosity)

    @wp.func
    def arrhenius_law(law: Rheology, temperature: real) -> real:
        return real(law.viscosity) * wp.exp(
            real(law.arrhenius) * (real(law.reference_temperature) - temperature)
        )

    return arrhenius_law if arrhenius else constant
