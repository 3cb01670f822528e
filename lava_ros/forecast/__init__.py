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

"""Looking ahead: one run, or the many of an ensemble. Never imports rclpy.

``arrival_time`` says how looks at a flow become arrival times; ``lookahead`` is the fork, and
``process`` a process of its own for it.

``sampling`` draws members, ``members`` runs them, ``probability`` makes maps of them, weighed by
``assimilation``; ``ensemble`` does all of it, with ``store``, ``pool`` and ``cluster``, and
``scores`` says how good it was.
"""
