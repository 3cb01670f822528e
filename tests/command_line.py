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

"""The command line, called by tests of several rooms."""

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO

from lava_ros.cli.main import main


def lava(*words: object) -> tuple[int, str, str]:
    """Call the command line: its exit status, what it prints, what it says on stderr."""
    with redirect_stdout(StringIO()) as out, redirect_stderr(StringIO()) as err:
        try:
            status = main([str(word) for word in words])
        except SystemExit as end:
            status = int(str(end.code))
    return status, out.getvalue(), err.getvalue()
