"""What several files look at, made once per process."""

import pytest
from export_cases import COMPILER, compiled_headers, exported_ur5


@pytest.fixture
def ur5():
    return exported_ur5()


@pytest.fixture
def headers():
    if COMPILER is None:
        pytest.skip("no C++ compiler (g++, clang++, c++)")
    return compiled_headers()
