"""pinfric first: it sets OMP_WAIT_POLICY, which counts only if set before Pinocchio loads."""

import pinfric  # noqa: F401
