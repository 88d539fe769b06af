import pytest
from export_cases import COMPILER, compiled_headers, exported_ur5


@pytest.fixture
def ur5():
    return exported_ur5()


@pytest.fixture(params=["-Og", pytest.param("-O2", marks=pytest.mark.slow)])  # 2 s; 5 s
def headers(request):
    if COMPILER is None:
        pytest.skip("no C++ compiler (g++, clang++, c++)")
    return compiled_headers(request.param)
