import pytest
from replay_cases import simulated_pendulum, three_links


@pytest.fixture
def three_link():
    return three_links()


@pytest.fixture
def pendulum_motion():
    return simulated_pendulum()
