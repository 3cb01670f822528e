# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Commands as tests call them: those that have to go well, and those that have to be refused."""

from command_line import lava


def done(*words: object) -> str:
    """What a command that goes well prints."""
    status, out, err = lava(*words)
    assert status == 0, err
    return out


def refused(*words: object) -> str:
    """What a command says of input that cannot be used, which is all that it says."""
    status, out, err = lava(*words)
    assert (status, out) == (2, ''), out + err
    return err
