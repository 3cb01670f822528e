# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Carriers of the lava, particles or cells: their names, and their descriptions for people.

Commands import this file for their help, so it imports nothing.
"""

#: Solvers by name (``Accuracy.method``), the default first.
METHODS = ('particles', 'cells')

#: Choice of the method by the flow (``method.choose_method``).
AUTO = 'auto'

#: Values of the option and the parameter ``method``, the default first, and their meaning.
METHOD_CHOICES = (*METHODS, AUTO)
METHOD_MEANING = (
    'carriers of the lava: particles, or cells, which take less time and lack some effects; '
    'auto: cells where they take less time and have the effects that the flow needs'
)

#: Names of the carriers that are counted, by method.
COUNTED = {'particles': 'particles', 'cells': 'cells with lava'}


def count_key(method: str) -> str:
    """Return the key of the number of particles, or of cells with lava, in every output."""
    return COUNTED[method].replace(' ', '_')


def max_count_key(method: str) -> str:
    """Return the key of the largest number of particles, or of cells with lava, in any map."""
    return f'{count_key(method)}_at_most'


def across_key(method: str) -> str:
    """Return the key of the number of particles, or of cells, across the flow."""
    return f'{method}_across'


def describe_carriers(method: str, spacing: str = '') -> str:
    """Return the carriers of the lava in words, with their spacing [m] if it is known."""
    if method == 'cells':
        return 'depth-averaged lava on cells' + (f' of {spacing} m' if spacing else '')
    return 'depth-averaged lava as particles' + (f' {spacing} m apart' if spacing else '')
