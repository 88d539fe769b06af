import pytest
from accuracy_cases import studied_pendulum


@pytest.fixture
def pendulum():
    return studied_pendulum()
