# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Sums over neighbours on a CPU, eight neighbours at a time.

A GPU assigns one neighbour to each of 32 threads. A CPU core can also add eight numbers at once,
but compilers do not vectorize loops over rows of about seven neighbours. This module generates the
C++ of device functions with Clang's vector types; on a processor with narrower vectors, each is
split into several. Products and sums are fused where the processor supports it, in an order that
depends only on the particle.
"""

_AROUND = """{
#pragma clang fp contract(fast)
    typedef float wide __attribute__((vector_size(32)));
    typedef int whole __attribute__((vector_size(32)));
    const whole lane = {0, 1, 2, 3, 4, 5, 6, 7};
    const wide none = {};
    const int last_place = values.shape[0] - 8;
    wide ZEROS;
    for (int row = box[0]; row < box[1]; ++row) {
        const int end = cells.starts.data[row * cells.columns + box[3]];
        for (int j = cells.starts.data[row * cells.columns + box[2]]; j < end; j += 8) {
            // near the end of the array some are read that are not meant
            const int place = j < last_place ? j : last_place;
            const whole is_in = (lane >= j - place) & (lane < end - place);
            wide a, b, c, d;
            __builtin_memcpy(&a, values.data + place, 32);
            __builtin_memcpy(&b, values.data + place + 2, 32);
            __builtin_memcpy(&c, values.data + place + 4, 32);
            __builtin_memcpy(&d, values.data + place + 6, 32);
            const wide ab_01 = __builtin_shufflevector(a, b, 0, 4, 8, 12, 1, 5, 9, 13);
            const wide cd_01 = __builtin_shufflevector(c, d, 0, 4, 8, 12, 1, 5, 9, 13);
            const wide ab_23 = __builtin_shufflevector(a, b, 2, 6, 10, 14, 3, 7, 11, 15);
            const wide cd_23 = __builtin_shufflevector(c, d, 2, 6, 10, 14, 3, 7, 11, 15);
            const wide other_0 = __builtin_shufflevector(ab_01, cd_01, 0, 1, 2, 3, 8, 9, 10, 11);
            const wide other_1 = __builtin_shufflevector(ab_01, cd_01, 4, 5, 6, 7, 12, 13, 14, 15);
            const wide other_2 = __builtin_shufflevector(ab_23, cd_23, 0, 1, 2, 3, 8, 9, 10, 11);
            const wide other_3 = __builtin_shufflevector(ab_23, cd_23, 4, 5, 6, 7, 12, 13, 14, 15);
            EACH
        }
    }
    auto total = [](wide v) {
        return ((v[0] + v[1]) + (v[2] + v[3])) + ((v[4] + v[5]) + (v[6] + v[7]));
    };
    return wp::vec_t<COUNT, wp::float32>(TOTALS);
}"""


def over_neighbors(each: str, count: int = 3) -> str:
    """Return the C++ of a float32 device function that computes sums over neighbours.

    Its arguments include ``values``, an array of at least eight vec4, and ``cells`` and ``box`` as
    in ``cells.cell_functions``; it returns a vector of ``count`` sums, at most 4. ``each`` is C++
    that adds the contributions of eight neighbours to ``sum_0``, ``sum_1`` and so on. ``other_0``
    to ``other_3`` are the components of their values, ``place`` is the index of the first of them,
    and ``is_in`` marks those that count; the values of the rest are arbitrary, even NaN. ``wide``
    is a vector of eight floats, ``whole`` of integers, ``none`` is 0.
    """
    sums = [f'sum_{n}' for n in range(count)]
    code = _AROUND.replace('ZEROS', ', '.join(f'{name} = {{}}' for name in sums))
    code = code.replace('TOTALS', ', '.join(f'total({name})' for name in sums))
    return code.replace('COUNT', str(count)).replace('EACH', each)
