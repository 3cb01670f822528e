# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Colours to send to a browser so that it shows the colours of a map despite tone mapping.

The browser draws a surface in ambient light with the filmic tone mapping ACES, as three.js has it:

    shown = B f(A c k / 0.6),  f(v) = (v (v + a) - b) / (v (d v + e) + g)

with the linear colour c of the surface and the intensity k of the light.
"""

import math
from typing import NamedTuple

import numpy as np

#: Intensity k of the light. It is large enough to show light colours; with more light, dark
#: colours, sent with 8 bits, would be coarse.
LIGHT = 4.0

#: Intensity of the light in viser, at which a diffuse surface has the colour c k.
AMBIENT = LIGHT * math.pi

#: Matrices A and B, and a, b, d, e, g of the tone mapping.
_IN = np.array([
    [0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777],
])
_OUT = np.array([
    [1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602],
])
_A, _B, _D, _E, _G = 0.0245786, 0.000090537, 0.983729, 0.4329510, 0.238081
_EXPOSURE = 0.6


class Tones(NamedTuple):
    """Colours to send to the browser, and those that it then shows; uint8, shape [count, 3]."""

    sent: np.ndarray
    shown: np.ndarray


def tones(colours: np.ndarray) -> Tones:
    """Return the colours to send so that the browser shows the given colours.

    ``colours`` are uint8, shape [count, 3]. A saturated colour can be out of range; the nearest is
    then shown.
    """
    mapped = np.clip(np.linalg.solve(_OUT, _linear(colours).T).T, 0.0, 1.0)
    # the larger root of the quadratic equation for v
    square, half = _D * mapped - 1.0, _E * mapped - _A
    root = np.sqrt(half**2 - 4.0 * square * (_G * mapped + _B))
    light = np.linalg.solve(_IN, (-half - root).T / (2.0 * square.T)).T * _EXPOSURE
    sent = _stored(np.clip(light / LIGHT, 0.0, 1.0))
    return Tones(sent, shown_by_browser(sent))


def shown_by_browser(sent: np.ndarray) -> np.ndarray:
    """Return the colours that a browser shows for those sent, uint8, shape [count, 3]."""
    value = _linear(sent) * LIGHT / _EXPOSURE @ _IN.T
    value = (value * (value + _A) - _B) / (value * (_D * value + _E) + _G)
    return _stored(np.clip(value @ _OUT.T, 0.0, 1.0))


def _linear(colours: np.ndarray) -> np.ndarray:
    """Convert sRGB, uint8, to linear colours from 0 to 1."""
    value = colours / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def _stored(linear: np.ndarray) -> np.ndarray:
    curve = 1.055 * np.maximum(linear, 1e-12) ** (1.0 / 2.4) - 0.055
    value = np.where(linear <= 0.0031308, 12.92 * linear, curve)
    return np.asarray(np.rint(255.0 * value).astype(np.uint8))
