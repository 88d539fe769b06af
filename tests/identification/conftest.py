import pytest
from identify_cases import LOGS, identified_arm, identified_ur10, needs_logs

from pinfric.identification.identify import Identified


@pytest.fixture
def found() -> Identified:
    return identified_arm()


@pytest.fixture
def ur10() -> Identified:
    if not LOGS.is_dir():
        pytest.skip(needs_logs.kwargs["reason"])
    return identified_ur10()
