import pytest
from log_cases import Truth


@pytest.fixture(scope="session")
def smooth(tmp_path_factory):
    return Truth(tmp_path_factory.mktemp("smooth"), "quintic")


@pytest.fixture(scope="session")
def jerky(tmp_path_factory):
    return Truth(tmp_path_factory.mktemp("jerky"), "trapezoidal")
