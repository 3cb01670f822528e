# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags of the maps of an ensemble."""

from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
import shutil

from lava_ros.errors import refusing
from lava_ros.files.resources import share_path
from lava_ros.forecast.members import Plan
from lava_ros.layers.forecast import EnsembleForecast, HazardMaps
from lava_ros.layers.layer_files import load_layers
from lava_ros.runs.map_bag import MapBag

#: Namespace of the topics.
NAMESPACE = '/lava'


def write_atlas_bag(
    directory: Path,
    maps: HazardMaps,
    plan: Plan,
    *,
    stamp_ns: int,
    custom_data: Mapping[str, str],
) -> None:
    """Write terrain, vents and the layers of an ensemble to a bag; replace an old bag.

    ``stamp_ns`` is the stamp of all messages [ns], the time at which the forecast starts;
    ``custom_data`` describes the bag in addition to its scene.

    Raises:
        LavaError: If the bag cannot be written.
    """
    terrain = plan.scene.terrain
    shown = EnsembleForecast(
        time=0.0,
        horizon=plan.horizon,
        threshold=plan.threshold,
        terrain=terrain,
        maps=maps,
        asked=maps.members,
        is_done=True,
        outlines=0,
        duration=0.0,
    )
    with refusing('bag', str(directory), 'a bag that can be written', OSError):
        if directory.exists():
            shutil.rmtree(directory)
        with closing(
            MapBag(directory, plan.scene, custom_data, namespace=NAMESPACE)
        ) as bag:
            bag.put_scene(plan.scene, 0.0, stamp_ns)
            for layer in load_layers(share_path('msg_configs/forecast.yaml')):
                if layer.is_ensemble:
                    bag.put_layer(layer, shown, stamp_ns)
