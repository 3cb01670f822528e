"""Fixtures for every test."""

import pytest


def _devices() -> list[str]:
    import warp as wp

    import lava_ros.simulation  # noqa: F401  (quietens Warp)

    return [str(device) for device in wp.get_devices()]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test that asks for ``device`` on every device there is."""
    if 'device' in metafunc.fixturenames:
        metafunc.parametrize('device', _devices())
