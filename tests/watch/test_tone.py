# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Colours of the live view, which a browser changes by its tone mapping."""

import numpy as np
import pytest

from lava_ros.products.colours import scale_of, STYLES
from lava_ros.watch.tone import shown_by_browser, tones


@pytest.mark.parametrize('style', STYLES)
def test_shown_colours_are_close_to_those_of_printed_maps(style):
    colours = scale_of(style, np.array([0.0, 1.0])).colours.resampled(24)
    wanted = colours(np.arange(colours.N), bytes=True)[:, :3]
    sent, shown = tones(wanted)
    np.testing.assert_array_equal(shown, shown_by_browser(sent))
    error = np.abs(shown.astype(int) - wanted.astype(int)).max(axis=1)
    # the saturated yellow of thick lava is outside the range of the tone mapping
    assert np.median(error) <= 3.0 and error.max() <= (28 if style == 'thickness' else 8)


def test_colours_without_correction_would_differ():
    # measured in Chromium with a light of intensity pi
    sent = np.array([[235, 113, 41]], dtype=np.uint8)
    assert np.abs(shown_by_browser(sent).astype(int) - sent).max() > 20
