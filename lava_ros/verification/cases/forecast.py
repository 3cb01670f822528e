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

"""A look ahead: when a travelling front reaches each cell, said long before."""

from dataclasses import replace
import math

import numpy as np

from lava_ros.accuracy import Accuracy
from lava_ros.forecast.lookahead import LookAhead
from lava_ros.scene import Scene, Vent
from lava_ros.verification import exact
from lava_ros.verification.cases.case import (
    Case,
    GRAVITY,
    ISOTHERMAL,
    Measurement,
    NU,
    plane,
    Run,
    SLOPING,
    Trial,
)


def _run(accuracy: Accuracy, device: str) -> Run:
    """A fissure across 20 degrees, forked when the front is 3 of 10 run-outs h cot b below it.

    Compared are the cells from 5 to 10 run-outs down, in a band whose distance from the fissure's
    ends is 8: the last one measures as well the time that the map's cells and the looks take from
    what is known.
    """
    slope, flux = math.radians(20.0), 0.5
    solution = exact.SlopeFlux(flux, slope, NU, GRAVITY)
    run_out, cosine = solution.run_out, math.cos(slope)
    width, last = 24.0 * run_out, 10.0 * run_out
    threshold = 0.1 * solution.thickness
    end = solution.arrival(last, threshold)
    window = (-6.0 * run_out, -width, (last + 8.0 * run_out) * cosine, width)
    vent = Vent(
        (0.0, -0.5 * width), flux * width, radius=0.2 * run_out, end=(0.0, 0.5 * width)
    )
    trial = Trial(
        Scene(plane(window, 0.6 * run_out, slope), (vent,), ISOTHERMAL, gravity=GRAVITY),
        effects=SLOPING,
        accuracy=replace(
            accuracy,
            spacing=0.2 * run_out / accuracy.refinement,
            thickness=solution.thickness / cosine,
        ),
        device=device,
    )
    start = 0.3 * end
    trial.advance(start)
    ahead = LookAhead(
        trial.simulation.checkpoint(),
        horizon=1.1 * end - start,
        threshold=threshold / cosine,
        device=device,
    )
    forecast = ahead.run()
    terrain = forecast.terrain
    rows, columns = (np.arange(count) + 0.5 for count in terrain.elevation.shape)
    x = (terrain.origin[0] + columns * terrain.resolution) / cosine
    y = terrain.origin[1] + rows * terrain.resolution
    here = np.ix_(np.abs(y) < 4.0 * run_out, (x > 0.5 * last) & (x < last))
    cell = terrain.resolution / cosine
    measured = start + forecast.arrival[here].astype(np.float64)
    exactly = np.broadcast_to(
        [solution.mean_arrival(place, threshold, cell) for place in x[here[1][0]]], measured.shape
    )
    # NaN, an error, where the front did not arrive
    worst = np.unravel_index(np.argmax(np.abs(measured / exactly - 1.0)), measured.shape)
    run = trial.run(
        'look_ahead',
        Measurement('arrival', float(measured.mean()), float(exactly.mean()), 's'),
        Measurement('worst cell', float(measured[worst]), float(exactly[worst]), 's'),
    )
    return replace(
        run,
        particles=forecast.particle_count,
        steps=ahead.steps.count,
        evaluations=ahead.steps.evaluations,
        simulated_time=forecast.time + forecast.horizon,
        wall_time=run.wall_time + forecast.duration,
    )


CASES = (Case('look_ahead', 'arrival times said ahead', 'Huppert 1982 (Nature)', _run),)
