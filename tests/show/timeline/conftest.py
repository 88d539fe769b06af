from show.replay.conftest import pendulum_motion, three_link

__all__ = ["pendulum_motion", "three_link"]
