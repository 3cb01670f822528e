# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The limit of a displacement to the range for which a step is valid."""

from functools import lru_cache
import math

import numpy as np
import pytest
import warp as wp

from lava_ros.simulation.particles.layout import arguments_type
from lava_ros.simulation.particles.terrain import StaggeredTerrain
from lava_ros.simulation.step.motion import _guard_function
from solver import incline

#: Kernel radius, maximum displacement that steps are chosen for, and thickness of the lava [m].
RADIUS, REACH, THICKNESS = 10.0, 5.0, 2.0


@lru_cache
def limit(is_pushed):
    """Return a kernel that limits one displacement."""
    guard = _guard_function(wp.float64, is_pushed)

    @wp.kernel(module='unique')
    def limit_one(
        m: arguments_type(wp.float64), way: wp.vec2d, thickness: wp.float64, head: wp.float64,
        out: wp.array(dtype=wp.vec2d),
    ):
        out[0] = guard(m, wp.vec2d(), way, thickness, head)

    return limit_one


def guarded(way, *, rise=0.0, head=0.0, is_pushed=False):
    """Return the displacement [m] that is left of one, on ground that rises towards +x."""
    arguments = arguments_type(wp.float64)()
    arguments.ground = StaggeredTerrain(incline(-rise, 40, 40, 4.0), 'float64', 'cpu').ground
    arguments.constants.radius, arguments.constants.reach = RADIUS, REACH
    out = wp.zeros(1, dtype=wp.vec2d, device='cpu')
    wp.launch(
        limit(is_pushed), 1, inputs=[arguments, wp.vec2d(*way), THICKNESS, head], outputs=[out],
        device='cpu',
    )
    return out.numpy()[0]


@pytest.mark.parametrize('angle', [0.0, 2.0, 4.0])
def test_displacement_is_at_most_twice_that_of_the_step(angle):
    direction = np.array([math.cos(angle), math.sin(angle)])
    for factor, kept in ((0.1, 0.1), (1.95, 1.95), (2.05, 2.0), (1000.0, 2.0)):
        assert guarded(factor * REACH * direction) == pytest.approx(kept * REACH * direction)


@pytest.mark.parametrize('is_pushed', [False, True])
@pytest.mark.parametrize(('lift', 'head', 'fraction'), [
    (0.95, 0.0, 1.0), (1.05, 0.0, 0.5), (1.95, 0.0, 0.5), (2.05, 0.0, 0.25),
    (1.05, 0.1, 1.0), (1.95, 1.0, 1.0), (2.05, 1.0, 0.5), (-50.0, 0.0, 1.0),
])
def test_displacement_lifts_lava_by_its_thickness_and_head(lift, head, fraction, is_pushed):
    """A way that would lift it higher is halved; lift and head are over the thickness."""
    way = np.array([8.0, 0.0])
    found = guarded(
        way, rise=lift * THICKNESS / way[0], head=head * THICKNESS, is_pushed=is_pushed
    )
    assert found == pytest.approx(fraction * way)


@pytest.mark.parametrize('length', [0.01, 1.0])
def test_surface_slope_moves_lava_up_no_steeper_ground(length):
    """The steepest surface is an edge whose lava is twice as thick behind the particle."""
    # the integral of the Wendland kernel along the edge, of which one side has lava
    edge = 14.0 / (3.0 * math.pi)
    steepest, way = 2.0 * edge * THICKNESS / RADIUS, np.array([length, 0.0])
    assert guarded(way, rise=0.95 * steepest) == pytest.approx(way)
    assert np.array_equal(guarded(way, rise=1.05 * steepest), [0.0, 0.0])
    # other forces push it
    assert guarded(way, rise=1.05 * steepest, is_pushed=True) == pytest.approx(way)
