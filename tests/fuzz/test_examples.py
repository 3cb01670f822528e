# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The fuzzers of a test run try the same examples, so that a failure repeats."""

import importlib.util
import sys

from hypothesis import settings
from hypothesis import strategies as st


def test_examples_do_not_depend_on_the_modules_that_are_loaded(in_part, tmp_path, monkeypatch):
    def drawn():
        examples = []

        def collect(numbers):
            examples.append(numbers)

        in_part(collect, settings(derandomize=True), numbers=st.lists(st.integers(1000, 10**9)))
        return examples

    before = drawn()
    path = tmp_path / 'constants.py'
    path.write_text(f'NUMBERS = {list(range(1001, 2000))}')
    spec = importlib.util.spec_from_file_location('constants', path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, 'constants', module)
    spec.loader.exec_module(module)
    assert drawn() == before
