# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Run `lava` commands that must succeed (`done`) or fail (`refused`)."""

from command_line import lava


def done(*words: object) -> str:
    """Return the output of a command that must succeed."""
    status, out, err = lava(*words)
    assert status == 0, err
    return out


def refused(*words: object) -> str:
    """Return the error message of a command with unusable input, its only output."""
    status, out, err = lava(*words)
    assert (status, out) == (2, ''), out + err
    return err
