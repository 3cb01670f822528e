# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Viscosity of a silicate melt from its composition: log10 mu = A + B / (T - C).

A is constant; B and C are sums over molar percentages of oxides (Giordano, Russell and Dingwell
2008, Earth Planet. Sci. Lett. 271, 123-134, table 1).
"""

from functools import partial
import math

from lava_ros import validation

#: Molar mass of each oxide [g/mol]. FeO is all iron; F2O-1 is fluorine in place of oxygen.
MOLAR_MASSES = {
    'SiO2': 60.0843,
    'TiO2': 79.8658,
    'Al2O3': 101.961276,
    'FeO': 71.8444,
    'MnO': 70.937449,
    'MgO': 40.3044,
    'CaO': 56.0774,
    'Na2O': 61.97894,
    'K2O': 94.196,
    'P2O5': 141.9446,
    'H2O': 18.01528,
    'F2O-1': 37.9968,
}

#: Check of each oxide.
OXIDE_CHECK = partial(validation.number, at_least=0.0, at_most=100.0, unit='wt%')

#: Minimum and maximum sum of the oxides without H2O [wt%].
TOTAL_RANGE = (95.0, 102.0)

#: The constant A [log10 Pa s] of all melts: mu at infinite temperature.
VFT_A = -4.55


def vft_constants(label: str, composition: object) -> dict[str, float]:
    """Return the constants ``vft_a``, ``vft_b`` [K] and ``vft_c`` [K] of a melt.

    Args:
        label: Name of the composition in errors.
        composition: Mapping from the oxides of ``MOLAR_MASSES`` to wt%; 0 without. H2O is used as
            given, and the other oxides are scaled so that all sum to 100 wt%, as in the
            spreadsheet of the authors.

    Raises:
        LavaError: If an oxide is not known or a number is not valid.
    """
    given = validation.keys(label, composition, allowed=MOLAR_MASSES, required=['SiO2'])
    weights = {name: OXIDE_CHECK(f'{label}.{name}', value) for name, value in given.items()}
    water = weights.pop('H2O', 0.0)
    least, most = TOTAL_RANGE
    # the error shows the sum without the digits of rounding
    total = round(sum(weights.values()), 6)
    field = f'the sum of {label} without H2O'
    validation.number(field, total, at_least=least, at_most=most, unit='wt%')
    weights = {name: value * (100.0 - water) / total for name, value in weights.items()}
    weights['H2O'] = water
    moles = {name: weights.get(name, 0.0) / mass for name, mass in MOLAR_MASSES.items()}
    percent = 100.0 / sum(moles.values())
    si, ti, al, fe, mn, mg, ca, na, k, p, h, f = (percent * item for item in moles.values())
    volatiles = h + f
    b = (
        159.56 * (si + ti) - 173.34 * al + 72.13 * (fe + mn + p) + 75.69 * mg - 38.98 * ca
        - 84.08 * (na + volatiles) + 141.54 * (volatiles + math.log(1.0 + h))
        - 2.43 * (si + ti) * (fe + mn + mg) - 0.91 * (si + ti + al + p) * (na + k + h)
        + 17.62 * al * (na + k)
    )
    c = (
        2.75 * si + 15.72 * (ti + al) + 8.32 * (fe + mn + mg) + 10.2 * ca - 12.29 * (na + k)
        - 99.54 * math.log(1.0 + volatiles)
        + 0.3 * (al + fe + mn + mg + ca - p) * (na + k + volatiles)
    )
    # a composition far from those of silicate melts can make them negative
    for name, value in {'B': b, 'C': c}.items():
        validation.number(f'{name} by {label}', value, above=0.0, unit='K')
    return {'vft_a': VFT_A, 'vft_b': b, 'vft_c': c}
