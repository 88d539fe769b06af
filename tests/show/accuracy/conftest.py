from accuracy.conftest import pendulum

__all__ = ["pendulum"]
