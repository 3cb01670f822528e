# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Pictures of the quality of probability forecasts."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.files.pictures import new_figure, save_picture
from lava_ros.forecast.scores import brier_score, reliability
from lava_ros.products.page_layout import shrink_title
from lava_ros.products.plot import INK


def write_reliability(
    probability: np.ndarray, came: Sequence[np.ndarray], output: Path
) -> None:
    """Write a reliability diagram of maps at several times, whose cells count together.

    Args:
        probability: Probability, 0 to 100 %, NaN unknown, shape [times, rows, columns].
        came: Inundated cells at each time, bool, shape [rows, columns].
        output: The picture; the suffix sets the format.

    Raises:
        LavaError: If matplotlib is not installed, or the picture cannot be written.
    """
    with new_figure('reliability', output, (5.0, 4.4), dpi=110) as figure:
        axes = figure.add_axes((0.12, 0.12, 0.84, 0.8))
        draw_reliability(axes, 0.01 * probability, np.stack(came))
        save_picture(figure, output, title='Reliability')


def draw_reliability(
    axes: Any, probability: np.ndarray, came: np.ndarray, name: str = ''
) -> None:
    """Draw a reliability diagram: fraction of inundated cells by forecast probability.

    ``probability`` is from 0 to 1; ``came`` (inundated) is bool, of the same shape. ``name`` is
    the name of the ensemble, for the title.
    """
    bins = [item for item in reliability(probability, came) if item.count]
    axes.plot([0, 100], [0, 100], color='#999999', linewidth=1.0, label='perfect')
    stated = [100.0 * item.forecast for item in bins]
    seen = [100.0 * item.observed for item in bins]
    axes.plot(stated, seen, 'o-', color='#a81d1d', markersize=4, label='this ensemble')
    for item, *place in zip(bins, stated, seen, strict=True):
        axes.annotate(
            f'{item.count}', place, (4, -8), textcoords='offset points', fontsize=6, color=INK
        )
    axes.set(xlim=(-4, 108), ylim=(-4, 108))
    axes.set_xlabel('forecast probability [%] (numbers: cells)', fontsize=8, labelpad=2)
    axes.set_ylabel('cells that lava reached [%]', fontsize=8, labelpad=2)
    axes.tick_params(labelsize=7.5)
    axes.legend(fontsize=7, frameon=False, loc='upper left')
    title = f'Reliability, Brier score {brier_score(probability, came):.3g}'
    title = f'{name}: {title}' if name else title
    text = axes.set_title(title, loc='left', fontsize=10, color=INK, pad=5)
    shrink_title(text, axes)
