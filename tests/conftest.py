"""pinfric first: it sets OMP_WAIT_POLICY, which counts only if set before Pinocchio loads."""

import pinfric  # noqa: F401
from pinfric.model import compiled, interpreted

# What a command prints is compared word for word, be the kernels compiled already or not.
compiled.say_compiling = lambda again="": None
# Tests are of compiled kernels; what is interpreted has its own (`model/test_interpreted.py`).
interpreted.PATIENCE = 0.0
