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

"""How much is tried: a little in every test run, a lot in `make nightly`."""

from hypothesis import HealthCheck, settings

from ros.conftest import graph  # noqa: F401

# Scenes, and messages over DDS, of a run; every test run tries the same ones.
settings.register_profile(
    'ci',
    max_examples=100,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=list(HealthCheck),
    print_blob=True,
)
settings.register_profile(
    'nightly', settings.get_profile('ci'), max_examples=2000, derandomize=False
)
settings.load_profile('ci')
