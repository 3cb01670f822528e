# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Third-order limiter of the slope at a face (Koren 1993)."""

#: Name in C++: the slope by the differences behind and ahead, 0 where they differ in sign. Needs
#: ``larger`` and ``smaller``.
KOREN = """
    auto koren = [&](float behind, float ahead) {
        const float third = (behind + 2.0f * ahead) * (1.0f / 3.0f);
        return larger(0.0f, smaller(third, 2.0f * smaller(behind, ahead)))
            + smaller(0.0f, larger(third, 2.0f * larger(behind, ahead)));
    };
"""
