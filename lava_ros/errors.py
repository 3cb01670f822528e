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

"""The one exception this package raises for bad input."""


#: Longest text of a value in a message [characters]; of a longer one the middle is left out.
LONGEST_VALUE = 120


class LavaError(ValueError):
    """Input that cannot be used.

    The message is one sentence that names the field, the value and what would be right, so that a
    node can log it and a command can print it as it is.

    Attributes:
        field: Dotted name of what is wrong, for example ``vents[0].discharge``.
        value: The offending value.
        expected: What would be right, as a phrase.
    """

    def __init__(self, field: str, value: object, expected: str) -> None:
        """Compose the sentence from its three parts."""
        self.field = field
        self.value = value
        self.expected = expected
        shown = repr(value)
        if len(shown) > LONGEST_VALUE:
            # of a path the end says most
            half = (LONGEST_VALUE - 3) // 2
            shown = f'{shown[:half]}...{shown[-half:]}'
        super().__init__(f'{field} is {shown}, expected {expected}')

    def __reduce__(self) -> tuple[type['LavaError'], tuple[str, object, str]]:
        """Make it again in another process, which raises it there as it was raised here."""
        return type(self), (self.field, self.value, self.expected)
