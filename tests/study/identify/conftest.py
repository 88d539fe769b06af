"""The identified arm that several files look at."""

import pytest
from identify_cases import identified_arm

from pinfric.study.identify.identify import Identified


@pytest.fixture
def found() -> Identified:
    return identified_arm()
